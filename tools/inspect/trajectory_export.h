// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A run's trajectory and the file that it goes to.
struct TrajectoryFile {
  const RunRecord* run = nullptr;  ///< Borrowed.
  std::string path;
};

/// A file `<run>.tum` in a folder for each run that has a trajectory. A run's name comes from a log
/// file: letters, digits, `.`, `_` and `-` stay, and others become `_`; of runs that would share a
/// name, the later ones get `-2`, `-3` ….
std::vector<TrajectoryFile> TrajectoryFiles(const std::vector<RunRecord>& runs,
                                            const std::string& folder);

/// The run of that name, or whose identity begins with the text.
/// Errors: kNotFound, naming the runs that there are; kInvalidArgument if it may be several.
StatusOr<const RunRecord*> FindRun(const std::vector<RunRecord>& runs, const std::string& text);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/run/run.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Paths of all files in a folder and its subfolders whose names have an ending, in order. Links to
/// folders are not followed. Errors: kNotFound if there is no such folder; kUnavailable if it
/// cannot be read.
/// @param unreadable  Gets the subfolders that cannot be read, and are left out; may be null.
StatusOr<std::vector<std::string>> FindFiles(const std::string& folder,
                                             const std::string& ending,
                                             std::vector<std::string>* unreadable = nullptr);

/// What tells a run log from others, without reading all of it.
struct LogHead {
  std::string path;
  RunInfo info;
  Stamp begin;
  std::string sha256;  ///< Empty if the run has a UUID.

  const std::string& identity() const { return info.uuid.empty() ? sha256 : info.uuid; }

  /// Whether a run was mapped from this log or another copy of it.
  bool IsOf(const RunRecord& run) const {
    return identity() == run.identity() || identity() == run.sha256 ||
           (!sha256.empty() && sha256 == run.sha256);
  }
};

/// Reads a run log's head; one whose run has no UUID is hashed.
/// Errors: as RunLogStream; kInvalidArgument if it holds no item.
StatusOr<LogHead> ReadLogHead(const std::string& path);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"

namespace shiftmap {

/// When a file was changed last, by the clock of the machine that has it; nothing if there is none.
/// Unlike the time of its content, nobody sets it.
std::optional<Stamp> ChangedAt(const std::string& path);

/// A run log as it was when a build read it.
struct ReadLog {
  std::string path;
  std::optional<Stamp> changed;  ///< ChangedAt().
};

/// Names of the runs of a build.
class RunNames {
 public:
  /// @param paths  Of its logs.
  explicit RunNames(const std::vector<std::string>& paths);

  /// The stem of a log's path, and its folder before it where another one of the logs has the same
  /// stem.
  std::string Of(const std::string& path) const;

 private:
  std::map<std::string, std::set<std::string>> paths_;  // By stem.
};

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
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

/// The name of a run: the stem of its log's path, and its folder before it where another log of
/// `paths` has the same stem.
std::string RunNameOf(const std::string& path, const std::vector<std::string>& paths);

}  // namespace shiftmap

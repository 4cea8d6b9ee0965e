// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <string>

#include "mapstore/core/ids.h"

namespace shiftmap {

/// A state of a landmark for people: `absent`, `mode 2`.
inline std::string ModeName(ModeNumber mode) {
  return mode == kAbsent ? "absent" : fmt::format("mode {}", mode.value());
}

}  // namespace shiftmap

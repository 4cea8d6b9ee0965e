// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

#include "mapstore/core/ids.h"

namespace shiftmap {

/// Number of scans by the direction from the landmark to the vehicle in the map frame: entry i
/// counts those in [i, i + 1) · 45° - 180°.
using DirectionCounts = std::array<int, 8>;

/// The scans that had a landmark well in view while it stood at a mode.
struct Visibility {
  DirectionCounts seen = {};
  DirectionCounts missed = {};

  Visibility& operator+=(const Visibility& other) {
    for (std::size_t i = 0; i < seen.size(); ++i) {
      seen[i] += other.seen[i];
      missed[i] += other.missed[i];
    }
    return *this;
  }

  friend bool operator==(const Visibility&, const Visibility&) = default;
};

/// The same of a mode of a map version.
struct ModeVisibility {
  Signature signature;
  ModeNumber mode;
  Visibility scans;
};

}  // namespace shiftmap

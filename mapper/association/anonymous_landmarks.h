// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapstore/map/mode.h"

namespace shiftmap {

struct AnonymousMergeOptions {
  double gate_probability = 0.99;  ///< Positions beyond it are told apart.
  double distance_m = 1.0;         ///< So are positions further apart than this.
  double position_floor_m = 0.07;  ///< Added to the uncertainty of either. [m]
};

/// Adds the landmarks without signature that one run found to those of the map, which are in the
/// same frame. One that is not told apart from a landmark of the map is that landmark; closest
/// pairs first, each landmark once. The better known position of the two stays: both contain the
/// error of the alignment, and a mean would count it twice. The map's number stays; others get the
/// numbers behind the highest, in their order.
/// @param found  Of one run, so that no two are the same landmark; numbers are not read.
void AddAnonymousLandmarks(const std::vector<Mode>& found,
                           const AnonymousMergeOptions& options,
                           std::vector<Mode>* landmarks);

}  // namespace shiftmap

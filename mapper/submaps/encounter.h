// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <vector>

#include "mapper/problem/map_problem.h"

namespace shiftmap {

/// A mode of a submap beside the mode of its group that is nearest to it in the map.
struct Encounter {
  int group = 0;
  int mode = 0;  ///< In the submap's group.
  int flat = 0;  ///< In the submap.
  int nearest = kUnassigned;
  double squared_m2 = std::numeric_limits<double>::infinity();
};

/// All modes of a submap, in flat order.
/// @param submap  In the frame of the map.
std::vector<Encounter> Meet(const MapProblem& submap, const MapProblem& map);

/// Precondition: the encounter has a nearest mode.
const BuildMode& NearestMode(const MapProblem& map, const Encounter& encounter);

/// True if the nearest mode is one of the prior map.
bool MeetsPrior(const MapProblem& map, const Encounter& encounter);

}  // namespace shiftmap

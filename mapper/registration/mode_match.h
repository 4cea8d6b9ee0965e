// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <vector>

#include "mapper/state/build_state.h"

namespace shiftmap {

/// A mode of a run map beside the mode of its group that is nearest to it in the map.
struct ModeMatch {
  GroupIndex group;
  GroupModeIndex mode;  ///< In the run map's group.
  ModeIndex flat;       ///< In the run map.
  OptionalMode nearest = kUnassigned;
  double squared_m2 = std::numeric_limits<double>::infinity();
};

/// All modes of a run map, in flat order.
/// @param run_map  In the frame of the map.
std::vector<ModeMatch> MatchNearest(const BuildState& run_map, const BuildState& map);

/// Precondition: the mode_match has a nearest mode.
const BuildMode& NearestMode(const BuildState& map, const ModeMatch& mode_match);

/// True if the nearest mode is one of the prior map.
bool MatchesPrior(const BuildState& map, const ModeMatch& mode_match);

}  // namespace shiftmap

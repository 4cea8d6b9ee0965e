// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/mode_match.h"

namespace shiftmap {

std::vector<ModeMatch> MatchNearest(const BuildState& run_map, const BuildState& map) {
  std::vector<ModeMatch> mode_matches;
  ModeIndex flat;
  for (const GroupIndex group : run_map.modes.indices()) {
    const GroupModes& known = map.modes[group];
    for (const GroupModeIndex m : run_map.modes[group].indices()) {
      ModeMatch mode_match{group, m, flat++};
      for (const GroupModeIndex k : known.indices()) {
        const double squared =
            (known[k].p_map_landmark - run_map.modes[group][m].p_map_landmark).squaredNorm();
        if (squared >= mode_match.squared_m2) continue;
        mode_match.squared_m2 = squared;
        mode_match.nearest = k;
      }
      mode_matches.push_back(mode_match);
    }
  }
  return mode_matches;
}

const BuildMode& NearestMode(const BuildState& map, const ModeMatch& mode_match) {
  return map.modes[mode_match.group][*mode_match.nearest];
}

bool MatchesPrior(const BuildState& map, const ModeMatch& mode_match) {
  return mode_match.nearest && NearestMode(map, mode_match).number != kAbsent;
}

}  // namespace shiftmap

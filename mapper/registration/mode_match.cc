// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/mode_match.h"

namespace shiftmap {

std::vector<ModeMatch> MatchNearest(const BuildState& run_map, const BuildState& map) {
  std::vector<ModeMatch> mode_matches;
  ModeIndex flat;
  for (const GroupIndex group : run_map.modes.indices()) {
    const std::vector<BuildMode>& known = map.modes[group];
    for (std::size_t m = 0; m < run_map.modes[group].size(); ++m) {
      ModeMatch mode_match{group, static_cast<int>(m), flat++};
      for (std::size_t k = 0; k < known.size(); ++k) {
        const double squared =
            (known[k].p_map_landmark - run_map.modes[group][m].p_map_landmark).squaredNorm();
        if (squared >= mode_match.squared_m2) continue;
        mode_match.squared_m2 = squared;
        mode_match.nearest = static_cast<int>(k);
      }
      mode_matches.push_back(mode_match);
    }
  }
  return mode_matches;
}

const BuildMode& NearestMode(const BuildState& map, const ModeMatch& mode_match) {
  return map.modes[mode_match.group][static_cast<std::size_t>(mode_match.nearest)];
}

bool MatchesPrior(const BuildState& map, const ModeMatch& mode_match) {
  return mode_match.nearest != kUnassigned && NearestMode(map, mode_match).number != kAbsent;
}

}  // namespace shiftmap

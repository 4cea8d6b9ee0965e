// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/encounter.h"

#include <cstddef>

namespace shiftmap {

std::vector<Encounter> Meet(const MapProblem& submap, const MapProblem& map) {
  std::vector<Encounter> encounters;
  int flat = 0;
  for (std::size_t group = 0; group < submap.modes.size(); ++group) {
    const std::vector<BuildMode>& known = map.modes[group];
    for (std::size_t m = 0; m < submap.modes[group].size(); ++m) {
      Encounter encounter{static_cast<int>(group), static_cast<int>(m), flat++};
      for (std::size_t k = 0; k < known.size(); ++k) {
        const double squared =
            (known[k].p_map_landmark - submap.modes[group][m].p_map_landmark).squaredNorm();
        if (squared >= encounter.squared_m2) continue;
        encounter.squared_m2 = squared;
        encounter.nearest = static_cast<int>(k);
      }
      encounters.push_back(encounter);
    }
  }
  return encounters;
}

const BuildMode& NearestMode(const MapProblem& map, const Encounter& encounter) {
  return map.modes[static_cast<std::size_t>(encounter.group)]
                  [static_cast<std::size_t>(encounter.nearest)];
}

bool MeetsPrior(const MapProblem& map, const Encounter& encounter) {
  return encounter.nearest != kUnassigned && NearestMode(map, encounter).number != kAbsent;
}

}  // namespace shiftmap

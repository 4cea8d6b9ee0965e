// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/unassigned_sightings.h"

#include <algorithm>

#include "localizer/models/observation_model.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {

std::vector<UnassignedSighting> AgreeingSightings(const Window& window, int group, double gate) {
  std::vector<UnassignedSighting> loose;
  for (std::size_t f = 0; f < window.frames.size(); ++f) {
    const WindowFrame& frame = window.frames[f];
    for (std::size_t i = 0; i < frame.observations.size(); ++i) {
      const WindowObservation& seen = frame.observations[i];
      if (seen.group != group || seen.mode != kNoMode) continue;
      loose.push_back({static_cast<int>(f),
                       static_cast<int>(i),
                       LandmarkPosition(seen.factor.observation, frame.T_map_vehicle),
                       seen.cov_p_map});
    }
  }
  if (loose.empty()) return loose;
  const UnassignedSighting newest = loose.back();
  std::erase_if(loose, [&](const UnassignedSighting& other) {
    return SquaredMahalanobis(other.p_map_landmark - newest.p_map_landmark,
                              other.cov + newest.cov) >= gate;
  });
  return loose;
}

const UnassignedSighting& SharpestSighting(const std::vector<UnassignedSighting>& sightings) {
  return *std::min_element(sightings.begin(),
                           sightings.end(),
                           [](const UnassignedSighting& a, const UnassignedSighting& b) {
                             return a.cov.trace() < b.cov.trace();
                           });
}

}  // namespace shiftmap

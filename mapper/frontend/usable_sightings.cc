// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/usable_sightings.h"

#include <algorithm>
#include <map>

namespace shiftmap {

UsableSightings FindUsableSightings(const Scan& scan, const FrontEndOptions& options) {
  UsableSightings usable;
  std::map<Signature, std::vector<int>> by_signature;
  for (std::size_t i = 0; i < scan.observations.size(); ++i) {
    const Observation& observation = scan.observations[i];
    const auto index = static_cast<int>(i);
    if (observation.kind == Observation::Kind::kRangeBearing &&
        observation.z.x() < options.min_range_m) {
      ++usable.near;
    } else if (observation.signature.anonymous()) {
      usable.anonymous.push_back(index);
    } else {
      by_signature[observation.signature].push_back(index);
    }
  }
  const auto position = [&](int index) {
    return scan.observations[static_cast<std::size_t>(index)].PositionInVehicle();
  };
  for (const auto& [signature, indices] : by_signature) {
    const Eigen::Vector2d first = position(indices.front());
    const bool one_place = std::all_of(indices.begin(), indices.end(), [&](int index) {
      return (position(index) - first).norm() <= options.duplicate_distance_m;
    });
    if (one_place) {
      usable.named.push_back(indices.front());
    } else {
      usable.duplicate += static_cast<int>(indices.size());
    }
  }
  return usable;
}

}  // namespace shiftmap

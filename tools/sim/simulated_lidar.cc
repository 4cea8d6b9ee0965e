// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/simulated_lidar.h"

#include <algorithm>
#include <cmath>

#include "tools/sim/option_checks.h"

namespace shiftmap {

double RangeNoise::Sd(double range_m, double cos_incidence) const {
  return (base_sd_m + sd_per_m * range_m) / std::max(cos_incidence, min_cos);
}

double RangeNoise::DropoutProbability(double cos_incidence) const {
  return cos_incidence < grazing_cos ? 1.0 - cos_incidence / grazing_cos : 0.0;
}

Status RangeNoise::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("lidar noise", base_sd_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("lidar noise per metre", sd_per_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("lidar least cosine", min_cos));
  SHIFTMAP_RETURN_IF_ERROR(CheckProbability("lidar least cosine", min_cos));
  return CheckProbability("lidar grazing cosine", grazing_cos);
}

Status SimulatedLidar::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(sensor.Validate());
  SHIFTMAP_RETURN_IF_ERROR(noise.Validate());
  if (beams < 2) return InvalidArgument("world: lidar beams = {}, expected >= 2", beams);
  return OkStatus();
}

void TakeRanges(const RayCaster& walls,
                const SimulatedLidar& lidar,
                const Se2& T_map_vehicle,
                Random* random,
                std::span<double> ranges_m) {
  std::normal_distribution<double> normal;
  const Se2 T_map_lidar = T_map_vehicle * lidar.sensor.T_vehicle_lidar;
  const double max_range = lidar.sensor.max_range_m;
  for (std::size_t beam = 0; beam < ranges_m.size(); ++beam) {
    const double yaw = T_map_lidar.yaw() + lidar.sensor.Bearing(beam, ranges_m.size());
    const Eigen::Vector2d direction(std::cos(yaw), std::sin(yaw));
    const RayHit hit = walls.Cast(T_map_lidar.translation(), direction, max_range);
    ranges_m[beam] = max_range;
    if (!hit.hit()) continue;
    const double lost = lidar.noise.DropoutProbability(hit.cos_incidence);
    if (lost > 0.0 && Happens(lost, random)) continue;
    const double error = lidar.noise.Sd(hit.range_m, hit.cos_incidence) * normal(*random);
    ranges_m[beam] = std::clamp(hit.range_m + error, 0.0, max_range);
  }
}

}  // namespace shiftmap

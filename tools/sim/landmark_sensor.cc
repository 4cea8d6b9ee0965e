// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/landmark_sensor.h"

#include <algorithm>
#include <cmath>

#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

Observation Observe(const Signature& signature,
                    double range,
                    double bearing,
                    const SensorCalibration& sensor,
                    Random* random) {
  constexpr double kMinRange = 0.01;
  Observation observation;
  observation.signature = signature;
  observation.z.x() = std::max(kMinRange, range + Gaussian(sensor.sd_range_m, random));
  observation.z.y() = WrapAngle(bearing + Gaussian(sensor.sd_bearing_rad, random));
  return observation;
}

Observation Clutter(std::span<const SimulatedGroup> groups,
                    const SensorCalibration& sensor,
                    Random* random) {
  const auto g = std::uniform_int_distribution<std::size_t>(0, groups.size() - 1)(*random);
  // The square root makes it uniform over the area of the sector.
  const double range = sensor.max_range_m * std::sqrt(Uniform(0.0, 1.0, random));
  const double bearing = Uniform(-sensor.max_bearing_rad, sensor.max_bearing_rad, random);
  return Observe(groups[g].signature, range, bearing, sensor, random);
}

}  // namespace

Scan SenseLandmarks(std::span<const SimulatedGroup> groups,
                    std::span<const ModeNumber> active_mode,
                    const StampedPose& pose,
                    const SensorCalibration& sensor,
                    double clutter_per_scan,
                    const InSight& in_sight,
                    Random* random) {
  Scan scan{pose.stamp, {}};
  const Se2 T_vehicle_map = pose.T_map_vehicle.Inverse();
  for (std::size_t g = 0; g < groups.size(); ++g) {
    if (active_mode[g] == kAbsent) continue;
    const auto mode = static_cast<std::size_t>(active_mode[g].value());
    const Eigen::Vector2d& p = groups[g].modes[mode - 1];
    const Eigen::Vector2d q = T_vehicle_map * p;
    if (q.norm() >= sensor.max_range_m) continue;
    const double bearing = std::atan2(q.y(), q.x());
    if (std::abs(bearing) >= sensor.max_bearing_rad) continue;
    if (in_sight && !in_sight(p)) continue;
    if (!Happens(sensor.detection_probability, random)) continue;
    scan.observations.push_back(Observe(groups[g].signature, q.norm(), bearing, sensor, random));
  }
  if (clutter_per_scan > 0.0) {
    const int clutter = std::poisson_distribution<int>(clutter_per_scan)(*random);
    for (int i = 0; i < clutter; ++i) {
      scan.observations.push_back(Clutter(groups, sensor, random));
    }
  }
  return scan;
}

}  // namespace shiftmap

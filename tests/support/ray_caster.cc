// SPDX-License-Identifier: Apache-2.0
#include "tests/support/ray_caster.h"

#include <algorithm>
#include <cmath>

namespace shiftmap {

std::vector<double> CastScan(const std::vector<Wall>& walls,
                             const Se2& T_map_lidar,
                             std::size_t beams,
                             const LidarSensor& sensor) {
  std::vector<double> ranges;
  for (std::size_t beam = 0; beam < beams; ++beam) {
    const double yaw = T_map_lidar.yaw() + sensor.Bearing(beam, beams);
    const Eigen::Vector2d direction(std::cos(yaw), std::sin(yaw));
    double range = 100.0;
    for (const Wall& wall : walls) {
      // p + range · direction = a + share · (b - a).
      const Eigen::Vector2d along = wall.b - wall.a;
      const Eigen::Vector2d to_a = wall.a - T_map_lidar.translation();
      const double determinant = Cross(direction, along);
      if (std::abs(determinant) < 1e-12) continue;
      const double share = Cross(to_a, direction) / determinant;
      const double at = Cross(to_a, along) / determinant;
      if (at > 0.0 && share >= 0.0 && share <= 1.0) range = std::min(range, at);
    }
    ranges.push_back(range);
  }
  return ranges;
}

}  // namespace shiftmap

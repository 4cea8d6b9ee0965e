// SPDX-License-Identifier: Apache-2.0
#include "tools/lidar/scan_points.h"

#include <cmath>
#include <cstddef>

namespace shiftmap {

std::vector<ScanPoint> ScanPoints(std::span<const double> ranges_m, const LidarSensor& sensor) {
  std::vector<ScanPoint> points;
  if (ranges_m.size() < 2) return points;
  for (std::size_t beam = 0; beam < ranges_m.size(); ++beam) {
    const double range = ranges_m[beam];
    if (!sensor.Returned(range)) continue;
    const double bearing = sensor.Bearing(beam, ranges_m.size());
    points.push_back(
        {static_cast<int>(beam), range, {range * std::cos(bearing), range * std::sin(bearing)}});
  }
  return points;
}

}  // namespace shiftmap

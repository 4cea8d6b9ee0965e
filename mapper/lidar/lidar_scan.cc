// SPDX-License-Identifier: Apache-2.0
#include "mapper/lidar/lidar_scan.h"

#include <cmath>

namespace shiftmap {

Status LidarSensor::Validate() const {
  if (!(field_of_view_rad > 0.0 && field_of_view_rad < 2.0 * std::numbers::pi)) {
    return InvalidArgument("field_of_view_rad {}, expected in (0, 2π)", field_of_view_rad);
  }
  if (!(max_range_m > 0.0 && std::isfinite(max_range_m))) {
    return InvalidArgument("max_range_m {}, expected > 0", max_range_m);
  }
  return OkStatus();
}

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

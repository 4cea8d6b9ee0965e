// SPDX-License-Identifier: Apache-2.0
#include "mapstore/run/lidar_scan.h"

#include <cmath>

#include "mapstore/core/magnitude.h"

namespace shiftmap {

bool LidarSensor::AllRound(std::size_t beams) const {
  // Of a step, for angles that were rounded.
  constexpr double kSlack = 0.5;
  if (beams < 3) return false;
  const double step = field_of_view_rad / static_cast<double>(beams - 1);
  return field_of_view_rad + (1.0 + kSlack) * step >= 2.0 * std::numbers::pi;
}

Status LidarSensor::Validate() const {
  if (!(field_of_view_rad > 0.0 && field_of_view_rad < 2.0 * std::numbers::pi)) {
    return InvalidArgument("field_of_view_rad {}, expected in (0, 2π)", field_of_view_rad);
  }
  if (!(max_range_m > 0.0 && max_range_m <= kMaxRangeM)) {
    return InvalidArgument("max_range_m {}, expected in (0, {}]", max_range_m, kMaxRangeM);
  }
  const Se2& T = T_vehicle_lidar;
  if (!(std::abs(T.x()) <= kMaxMagnitude && std::abs(T.y()) <= kMaxMagnitude &&
        std::isfinite(T.yaw()))) {
    return InvalidArgument("lidar at x {} m, y {} m, yaw {} rad, expected finite numbers up to {}",
                           T.x(),
                           T.y(),
                           T.yaw(),
                           kMaxMagnitude);
  }
  return OkStatus();
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>

namespace shiftmap {

/// The angle equal to `angle_rad` modulo 2π in [-π, π].
inline double WrapAngle(double angle_rad) {
  if (std::abs(angle_rad) <= std::numbers::pi) return angle_rad;
  return std::remainder(angle_rad, 2.0 * std::numbers::pi);
}

}  // namespace shiftmap

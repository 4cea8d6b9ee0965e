// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/detection_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

// P(X < limit) for X ~ N(mean, variance).
double ProbabilityBelow(double limit, double mean, double variance) {
  constexpr double kMinVariance = 1e-12;  // Of less, the limit is a step.
  const double sd = std::sqrt(variance > kMinVariance ? variance : kMinVariance);
  const double x = (mean - limit) / (sd * std::numbers::sqrt2);
  return x < -6.0 ? 1.0 : 0.5 * std::erfc(x);  // To the last bit.
}

}  // namespace

bool Sector::Contains(const Eigen::Vector2d& q) const {
  return q.squaredNorm() <= max_range_m * max_range_m &&
         std::abs(WrapAngle(std::atan2(q.y(), q.x()) - centre_rad)) <= half_width_rad;
}

double SectorFieldOfView(const Eigen::Vector2d& range_bearing,
                         const Eigen::Matrix2d& cov,
                         const Sector& sector) {
  const double bearing = WrapAngle(range_bearing.y() - sector.centre_rad);
  const double in_range = ProbabilityBelow(sector.max_range_m, range_bearing.x(), cov(0, 0));
  const double in_sector = ProbabilityBelow(sector.half_width_rad, bearing, cov(1, 1)) -
                           ProbabilityBelow(-sector.half_width_rad, bearing, cov(1, 1));
  const double in_view = in_range * std::clamp(in_sector, 0.0, 1.0);
  return in_view >= 0.0 ? in_view : 0.0;  // What is not a number is not in view.
}

bool WellInView(const Eigen::Vector2d& q, const Sector& sector) {
  // Shares of the range and of the bearing.
  constexpr double kMinRange = 0.1;
  constexpr double kInside = 0.8;
  const double range = q.norm();
  const double bearing = WrapAngle(std::atan2(q.y(), q.x()) - sector.centre_rad);
  return range > kMinRange * sector.max_range_m && range < kInside * sector.max_range_m &&
         std::abs(bearing) < kInside * sector.half_width_rad;
}

double LogMissedRun(double log_missed, double occluded) {
  return std::log((1.0 - occluded) * std::exp(log_missed) + occluded);
}

}  // namespace shiftmap

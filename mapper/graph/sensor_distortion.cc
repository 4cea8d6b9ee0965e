// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/sensor_distortion.h"

#include <algorithm>
#include <cmath>

#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

// Range and bearing.
Eigen::Vector2d PolarOf(const Observation& observation) {
  if (observation.kind == Observation::Kind::kRangeBearing) return observation.z;
  return {observation.z.norm(), std::atan2(observation.z.y(), observation.z.x())};
}

}  // namespace

SensorDistortion::Monomials SensorDistortion::MonomialsOf(const Observation& observation) {
  const Eigen::Vector2d polar = PolarOf(observation);
  const double r = polar.x();
  const double b = polar.y();
  return Monomials{{1.0, r, b, r * r, r * b, b * b, r * b * b}};
}

Eigen::Matrix2d SensorDistortion::DzDPolar(const Observation& observation) {
  if (observation.kind == Observation::Kind::kRangeBearing) return Eigen::Matrix2d::Identity();
  const Eigen::Vector2d polar = PolarOf(observation);
  const Eigen::Vector2d ray(std::cos(polar.y()), std::sin(polar.y()));
  Eigen::Matrix2d dz;
  dz << ray, polar.x() * Eigen::Vector2d(-ray.y(), ray.x());
  return dz;
}

Observation SensorDistortion::Undistorted(const Observation& observation) const {
  if (coefficients.isZero(0.0)) return observation;
  constexpr double kMaxBearingError = 0.5;
  const double max_range_error = 0.5 * PolarOf(observation).x();
  Eigen::Vector2d error = coefficients * MonomialsOf(observation);
  error.x() = std::clamp(error.x(), -max_range_error, max_range_error);
  error.y() = std::clamp(error.y(), -kMaxBearingError, kMaxBearingError);
  Observation undistorted = observation;
  undistorted.z -= DzDPolar(observation) * error;
  if (observation.kind == Observation::Kind::kRangeBearing) {
    undistorted.z.y() = WrapAngle(undistorted.z.y());
  }
  return undistorted;
}

}  // namespace shiftmap

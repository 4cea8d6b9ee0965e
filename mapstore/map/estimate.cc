// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/estimate.h"

#include <cmath>
#include <limits>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
Interval IntervalOf(const Estimate& estimate) {
  const double half = kSigmas95 * estimate.sd;
  return {estimate.value, estimate.value - half, estimate.value + half};
}

Interval IntervalOf(const NoiseEstimate& noise) {
  if (!noise.known()) return {0.0, 0.0, std::numeric_limits<double>::infinity()};
  const auto dof = static_cast<int>(noise.dof);
  return {noise.sd,
          noise.sd * std::sqrt(dof / ChiSquareQuantile(0.975, dof)),
          noise.sd * std::sqrt(dof / ChiSquareQuantile(0.025, dof))};
}

Interval IntervalOf(const ShareEstimate& share, double sigmas) {
  const double p = share.share;
  const double n = share.trials;
  if (n <= 0.0) return {p, 0.0, 1.0};
  const double z2 = sigmas * sigmas;
  const double centre = (p + 0.5 * z2 / n) / (1.0 + z2 / n);
  const double half = sigmas / (1.0 + z2 / n) * std::sqrt(p * (1.0 - p) / n + 0.25 * z2 / (n * n));
  return {p, centre - half, centre + half};
}

Interval Exponential(const Interval& log) {
  return {std::exp(log.value), std::exp(log.low), std::exp(log.high)};
}

}  // namespace shiftmap

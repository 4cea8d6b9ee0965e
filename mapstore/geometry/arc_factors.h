// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

namespace shiftmap {

/// What the exponential map of SE(2) and its Jacobians need of the angle θ of a twist, to a
/// relative 1e-12 for every θ, also where the quotients cancel.
struct ArcFactors {
  double sin;
  double cos;
  double sinc;       ///< sin(θ) / θ
  double cosc;       ///< (1 - cos(θ)) / θ
  double sinc_rest;  ///< (θ - sin(θ)) / θ²
  double cosc_rest;  ///< (1 - cos(θ)) / θ²
};

inline ArcFactors ComputeArcFactors(double theta_rad) {
  // Below this the next terms of the series are smaller than a unit in the last place. Odometry and
  // residuals rarely turn more in a step, and need no sine and cosine then.
  constexpr double kSmallAngle = 0.05;
  const double t = theta_rad * theta_rad;
  ArcFactors f;
  if (std::abs(theta_rad) < kSmallAngle) {
    f.sinc_rest = theta_rad * (1.0 / 6.0 - t * (1.0 / 120.0 - t * (1.0 / 5040.0 - t / 362880.0)));
    f.cosc_rest = 0.5 - t * (1.0 / 24.0 - t * (1.0 / 720.0 - t / 40320.0));
    f.sinc = 1.0 - theta_rad * f.sinc_rest;
    f.cosc = theta_rad * f.cosc_rest;
    f.sin = theta_rad * f.sinc;
    f.cos = 1.0 - theta_rad * f.cosc;
    return f;
  }
  f.sin = std::sin(theta_rad);
  f.cos = std::cos(theta_rad);
  // 1 - cos(θ) = sin²(θ) / (1 + cos(θ)) is the better form for all but obtuse angles.
  const double one_minus_cos = f.cos > 0.0 ? f.sin * f.sin / (1.0 + f.cos) : 1.0 - f.cos;
  f.sinc = f.sin / theta_rad;
  f.cosc = one_minus_cos / theta_rad;
  f.sinc_rest = (theta_rad - f.sin) / t;
  f.cosc_rest = one_minus_cos / t;
  return f;
}

}  // namespace shiftmap

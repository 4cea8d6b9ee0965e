// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace shiftmap {

/// 95 % ellipse of a Gaussian: half axes, the longer one first, and the rotation of that one from x
/// towards y.
struct ConfidenceEllipse {
  Eigen::Vector2d half_axes;  ///< [m]
  double rotation_rad = 0.0;
};

/// @param cov  [m²]
ConfidenceEllipse MakeEllipse(const Eigen::Matrix2d& cov);

}  // namespace shiftmap

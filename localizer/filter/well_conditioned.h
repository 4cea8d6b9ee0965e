// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <limits>

namespace shiftmap {

/// True if a symmetric S can be inverted with digits left: finite, positive definite, eigenvalues
/// at most some 10¹² apart. Values that a log may hold but no sensor has, such as a range of 10⁹ m
/// with a bearing that is off by degrees, leave an S that is rounding error.
inline bool IsWellConditioned(const Eigen::Matrix2d& S) {
  constexpr double kMinRatio = 1e-12;
  const double trace = S(0, 0) + S(1, 1);
  const double determinant = S(0, 0) * S(1, 1) - S(0, 1) * S(1, 0);
  // False for what is not a number; the determinant of numbers that are too small is 0.
  return trace > 0.0 && determinant > 0.0 && determinant > kMinRatio * trace * trace &&
         determinant < std::numeric_limits<double>::infinity();
}

}  // namespace shiftmap

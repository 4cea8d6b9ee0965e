// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/confidence_ellipse.h"

#include <Eigen/Eigenvalues>
#include <cmath>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {

ConfidenceEllipse MakeEllipse(const Eigen::Matrix2d& cov) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(cov);
  const Eigen::Vector2d axis = solver.eigenvectors().col(1);
  const Eigen::Vector2d sd = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  const double scale = std::sqrt(ChiSquareQuantile(0.95, 2));
  return {scale * Eigen::Vector2d(sd(1), sd(0)), std::atan2(axis.y(), axis.x())};
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/confidence_ellipse.h"

#include <cmath>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {

ConfidenceEllipse MakeEllipse(const Eigen::Matrix2d& cov) {
  const SigmaEllipse sigma = MakeSigmaEllipse(cov);
  const double scale = std::sqrt(ChiSquareQuantile(0.95, 2));
  return {scale * Eigen::Vector2d(sigma.major_m, sigma.minor_m), sigma.rotation_rad};
}

}  // namespace shiftmap

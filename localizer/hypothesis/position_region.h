// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

namespace shiftmap {

/// One normal distribution of a mixture over positions in the plane.
struct WeightedPosition {
  double weight = 0.0;
  Eigen::Vector2d p = Eigen::Vector2d::Zero();    ///< Mean. [m]
  Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();  ///< Positive semi-definite. [m²]
};

/// Probability of a position within `radius_m` of `center`.
///
///   P = Σ w_i ∫ φ(x; m_x, s_x) [Φ((h(x) - m_y) / s_y) - Φ((-h(x) - m_y) / s_y)] dx,
///   h(x) = √(r² - x²), over |x| <= r, in the axes of component i, about the center
///
/// by Gauss-Legendre quadrature in the angle asin(x / r), to about 1e-6.
/// @param mixture  Weights are scaled to the sum 1; not empty.
double ProbabilityWithin(std::span<const WeightedPosition> mixture,
                         const Eigen::Vector2d& center,
                         double radius_m);

/// The radius about `center` that holds the position with a probability in (0, 1), to 1e-5 of
/// itself. [m]
double RadiusHolding(double probability,
                     std::span<const WeightedPosition> mixture,
                     const Eigen::Vector2d& center);

}  // namespace shiftmap

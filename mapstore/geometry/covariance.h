// SPDX-License-Identifier: Apache-2.0
//
// Project-wide convention for uncertainty: a pose covariance is over (x, y, yaw) in that order,
// metres and radians, of the perturbation ξ in T_map_vehicle · Exp(ξ), so it is expressed in the
// vehicle frame. A position covariance is over (x, y) in the frame the position is in, square
// metres.
#pragma once

#include <Eigen/Core>

#include "mapstore/geometry/se2.h"

namespace shiftmap {

/// A pose and its covariance, which belong together.
struct PoseWithCovariance {
  Se2 T_map_vehicle;
  /// 3 x 3, order (x, y, yaw), perturbation T·Exp(ξ) in the vehicle frame. [m, m, rad]
  Eigen::Matrix3d cov_T_map_vehicle = Eigen::Matrix3d::Zero();
};

/// True if `matrix` is square, finite, symmetric to 1e-9 of its largest entry, and its smallest
/// eigenvalue is above `min_eigenvalue`.
bool IsSymmetricPositiveDefinite(const Eigen::Ref<const Eigen::MatrixXd>& matrix,
                                 double min_eigenvalue = 0.0);

/// (A + Aᵀ) / 2: undoes the asymmetry that rounding leaves in a covariance.
template <typename Derived>
typename Derived::PlainObject Symmetrized(const Eigen::MatrixBase<Derived>& matrix) {
  return 0.5 * (matrix + matrix.transpose());
}

/// The standard deviation of a 2 x 2 covariance in the direction in which it is largest.
double LargestSd(const Eigen::Matrix2d& cov);

/// Of a Gaussian with a covariance in m²: standard deviations along the axes of its ellipses, and
/// the direction of the longer one, from x towards y.
struct SigmaEllipse {
  double major_m = 0.0;
  double minor_m = 0.0;
  double rotation_rad = 0.0;
};

SigmaEllipse MakeSigmaEllipse(const Eigen::Matrix2d& cov_m2);

/// log N(ν; 0, S) for a 2-vector. Precondition: S symmetric positive definite.
double LogGaussian(const Eigen::Vector2d& nu, const Eigen::Matrix2d& S);

/// νᵀ S⁻¹ ν: chi-square with 2 degrees of freedom if ν ~ N(0, S).
double SquaredMahalanobis(const Eigen::Vector2d& nu, const Eigen::Matrix2d& S);

/// ξᵀ cov⁻¹ ξ with T_map_a · Exp(ξ) = T_map_b, the squared distance of two poses in standard
/// deviations: chi-square with 3 degrees of freedom if ξ ~ N(0, cov).
/// @param cov  3 x 3, order (x, y, yaw), in the frame of `a`. Precondition: positive definite.
double SquaredMahalanobis(const Se2& T_map_a, const Se2& T_map_b, const Eigen::Matrix3d& cov);

/// The value that a chi-square variable with `dof` degrees of freedom stays below with
/// `probability`.
/// @param probability  In (0, 1).
double ChiSquareQuantile(double probability, int dof);

/// The probability that a chi-square variable with `dof` degrees of freedom exceeds `value`; 0 if
/// that is not a number.
double ChiSquareTail(double value, int dof);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/geometry/covariance.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <cmath>
#include <numbers>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Closed form: maps have tens of thousands of 2 x 2 covariances.
double LargestEigenvalue(const Eigen::Matrix2d& matrix) {
  const double mean = 0.5 * (matrix(0, 0) + matrix(1, 1));
  return mean + std::hypot(0.5 * (matrix(0, 0) - matrix(1, 1)), matrix(0, 1));
}

double SmallestEigenvalue(const Eigen::Matrix2d& matrix) {
  const double largest = LargestEigenvalue(matrix);
  // By the determinant, which keeps its digits where the eigenvalues are far apart.
  return largest > 0.0 ? matrix.determinant() / largest : -1.0;
}

}  // namespace

bool IsSymmetricPositiveDefinite(const Eigen::Ref<const Eigen::MatrixXd>& matrix,
                                 double min_eigenvalue) {
  if (matrix.rows() != matrix.cols() || matrix.rows() == 0 || !matrix.allFinite()) return false;
  if (matrix.rows() == 2) {
    const Eigen::Matrix2d small = matrix;
    const double scale = small.cwiseAbs().maxCoeff();
    return std::abs(small(0, 1) - small(1, 0)) <= 1e-9 * scale &&
           SmallestEigenvalue(small) > min_eigenvalue;
  }
  const double scale = matrix.cwiseAbs().maxCoeff();
  if ((matrix - matrix.transpose()).cwiseAbs().maxCoeff() > 1e-9 * scale) return false;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(matrix, Eigen::EigenvaluesOnly);
  return solver.eigenvalues().minCoeff() > min_eigenvalue;
}

double SquaredMahalanobis(const Eigen::Vector2d& nu, const Eigen::Matrix2d& S) {
  return nu.dot(S.inverse() * nu);
}

double SquaredMahalanobis(const Se2& T_map_a, const Se2& T_map_b, const Eigen::Matrix3d& cov) {
  const Eigen::Vector3d xi = (T_map_a.Inverse() * T_map_b).Log();
  return xi.dot(cov.inverse() * xi);
}

double LargestSd(const Eigen::Matrix2d& cov) {
  return std::sqrt(std::max(0.0, LargestEigenvalue(cov)));
}

SigmaEllipse MakeSigmaEllipse(const Eigen::Matrix2d& cov_m2) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(cov_m2);
  const Eigen::Vector2d sd = solver.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  const Eigen::Vector2d axis = solver.eigenvectors().col(1);
  return {sd(1), sd(0), std::atan2(axis.y(), axis.x())};
}

double LogGaussian(const Eigen::Vector2d& nu, const Eigen::Matrix2d& S) {
  return -0.5 * SquaredMahalanobis(nu, S) - 0.5 * std::log(S.determinant()) -
         std::log(2.0 * std::numbers::pi);
}

double ChiSquareTail(double value, int dof) {
  SHIFTMAP_CHECK(dof > 0, "dof {}", dof);
  if (value <= 0.0) return 1.0;
  if (!std::isfinite(value)) return 0.0;
  return boost::math::cdf(boost::math::complement(boost::math::chi_squared(dof), value));
}

double ChiSquareQuantile(double probability, int dof) {
  SHIFTMAP_CHECK(probability > 0.0 && probability < 1.0 && dof > 0,
                 "probability {}, dof {}",
                 probability,
                 dof);
  return boost::math::quantile(boost::math::chi_squared(dof), probability);
}

}  // namespace shiftmap

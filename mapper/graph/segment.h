// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace shiftmap {

/// A matrix whose rows are in one piece each: the three rows of a pose are worked through together.
using PoseRows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// The normal equations of a segment of consecutive poses, before any is eliminated. Its boundary
/// is everything else that the segment's residuals depend on: the poses before and after it, its
/// run's calibration, the modes seen from it.
struct SegmentSystem {
  /// @param poses     Poses in the segment; there may be none.
  /// @param boundary  Dimension of the boundary.
  SegmentSystem(int poses, int boundary);

  /// Raises the diagonal by a share of itself.
  void Damp(double share);

  std::vector<Eigen::Matrix3d> A;  ///< H of each pose with itself, lower triangle.
  std::vector<Eigen::Matrix3d> E;  ///< H of pose i with pose i + 1; of all but the last.
  PoseRows B;                      ///< H of the poses with the boundary, three rows a pose.
  Eigen::VectorXd b;               ///< -gradient of the poses.
  Eigen::MatrixXd C;               ///< H of the boundary, lower triangle.
  Eigen::VectorXd c;               ///< -gradient of the boundary.
};

/// A segment of poses eliminated onto its boundary: the Cholesky factor of a block-tridiagonal
/// system, from the first pose to the last.
///
///   L Lᵀ = A,   Y = L⁻¹ B,   u = L⁻¹ b,   boundary: C - YᵀY, c - Yᵀu.
///
/// Linear in the poses, quadratic in the boundary.
class SegmentFactor {
 public:
  /// Takes the system apart; the Schur complement of the boundary is left in system->C, system->c.
  /// Nothing if the poses are not determined.
  static std::optional<SegmentFactor> Of(SegmentSystem* system);

  int poses() const { return static_cast<int>(L_.size()); }

  /// bᵀ A⁻¹ b of the poses alone.
  double Decrease() const { return u_.squaredNorm(); }

  /// Eliminates other right sides, a column each: b := L⁻¹ b, c := c - Yᵀ b.
  void Eliminate(PoseRows* b, Eigen::MatrixXd* c) const;

  /// The poses' step, given the boundary's: L⁻ᵀ (u - Y y), three rows a pose.
  Eigen::VectorXd Solve(const Eigen::VectorXd& boundary) const {
    return BackSubstitute(u_, boundary);
  }

  /// The same with another u: L⁻ᵀ (u - Y y).
  Eigen::VectorXd BackSubstitute(const Eigen::VectorXd& u, const Eigen::VectorXd& boundary) const;

 private:
  bool Factorize(SegmentSystem* system);

  std::vector<Eigen::Matrix3d> L_;  // Diagonal blocks; of their own diagonal the inverse.
  std::vector<Eigen::Matrix3d> F_;  // L_i⁻¹ E_i, the transposed blocks below the diagonal.
  PoseRows Y_;
  Eigen::VectorXd u_;
};

}  // namespace shiftmap

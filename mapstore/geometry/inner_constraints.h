// SPDX-License-Identifier: Apache-2.0
//
// Inner constraints of surveying (Baarda's S-transformation): the covariance of positions to each
// other, without what is common to all of them.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace shiftmap {

/// Mean of the positions, of which there is one at least. [m]
Eigen::Vector2d Centroid(const std::vector<Eigen::Vector2d>& positions);

/// The three directions in which all positions move together, orthonormal columns (2n x 3):
/// translation in x and y, rotation about the centroid. Observations between vehicle and landmarks
/// say nothing of them; they are the gauge of the map. Precondition: at least one position.
Eigen::MatrixXd GaugeDirections(const std::vector<Eigen::Vector2d>& positions);

/// q, stacked (x, y): how positions move as their scale grows; orthogonal to GaugeDirections(). [m]
Eigen::VectorXd OffsetsFromCentroid(const std::vector<Eigen::Vector2d>& positions);

/// What refers a joint covariance P to the positions as a whole, block by block:
///
///   (I - GGᵀ) P (I - GGᵀ) = P - G Wᵀ - W Gᵀ,   W = P G - ½ G (Gᵀ P G)
///
/// so that P need not be known as a whole.
struct STransformation {
  /// @param directions            G, orthonormal columns: GaugeDirections(), or more.
  /// @param cov_times_directions  P G.
  STransformation(Eigen::MatrixXd directions, const Eigen::MatrixXd& cov_times_directions);

  /// Block (a, b) of what P becomes, from that block of P. [m²]
  Eigen::Matrix2d Refer(int a, int b, const Eigen::Matrix2d& cov_a_b) const;

  Eigen::MatrixXd G;
  Eigen::MatrixXd W;
};

}  // namespace shiftmap

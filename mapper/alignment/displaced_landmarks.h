// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

namespace shiftmap {

struct DisplacementOptions {
  /// Probability that landmarks were displaced: each alone, or a first one of several together.
  double probability_displaced = 0.05;

  /// Probability that a landmark went along with another that was displaced.
  double probability_together = 0.3;

  /// How far they are displaced, per axis. [m]
  double sd_displacement_m = 1.0;
};

inline constexpr int kNotDisplaced = -1;

/// Which landmarks stand elsewhere than they did, decided for all of them at once.
///
/// The model: landmarks of a cluster c are displaced together, by u_c ~ N(0, sd_displacement² I).
/// The differences between where landmarks are and where they were are d = B u + e, e ~ N(0, cov),
/// with B the membership. The continuous u is integrated out,
///
///   log p(d | B) = log N(d; 0, cov) - ½ log|I + σ² BᵀΛB| + ½ wᵀ (σ⁻² I + BᵀΛB)⁻¹ w,
///   Λ = cov⁻¹,  w = BᵀΛd,
///
/// and the clusters of the largest posterior are searched: clusters grown from every landmark that
/// differs, then single landmarks moved between clusters, until nothing gains. Errors that
/// landmarks share (the datum, the scale) belong in `cov`; then a few displaced landmarks cannot
/// pass as many that stay, nor the other way around.
///
/// @param difference  Stacked (x, y). [m]
/// @param cov         Joint covariance of the differences if nothing was displaced, positive
///                    definite. [m²]
/// @return Per landmark its cluster, from 0, or kNotDisplaced. Deterministic.
std::vector<int> FindDisplaced(const Eigen::VectorXd& difference,
                               const Eigen::MatrixXd& cov,
                               const DisplacementOptions& options);

}  // namespace shiftmap

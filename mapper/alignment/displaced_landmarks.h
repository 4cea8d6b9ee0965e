// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "mapper/alignment/displacement_prior.h"

namespace shiftmap {

struct DisplacementOptions {
  DisplacementPriorOptions prior;

  /// How far they are displaced: standard deviations per axis, each as likely as the others. [m]
  std::array<double, 3> sd_displacement_m = {0.1, 0.3, 1.0};

  /// How well the scale of the covariance is known, as degrees of freedom of its variance factor.
  double variance_dof = 4.0;
};

inline constexpr int kNotDisplaced = -1;

/// Which landmarks stand elsewhere than they did, decided for all of them at once.
///
/// The model: landmarks of a cluster c are displaced together, by u_c ~ N(0, v σ² I). The
/// differences between where landmarks are and where they were are d = B u + e, e ~ N(0, v cov),
/// with B the membership. The variance factor v says how wrong the covariances of maps are: ν / v ~
/// χ²_ν, as in the tests of deformation analysis that use the variance factor that the data have.
/// Both u and v are integrated out, which leaves Student's t,
///
///   log p(d | B) = -½ log|I + σ² BᵀΛB| - ½ (ν + n) log(1 + (dᵀΛd - wᵀ (σ⁻² I + BᵀΛB)⁻¹ w) / ν),
///   Λ = cov⁻¹,  w = BᵀΛd,
///
/// n the dimension of d less the three of the datum, which float. It is averaged over σ, and the
/// clusters of the largest posterior are searched: clusters grown from the landmarks that differ
/// most, then single landmarks moved between clusters, until nothing gains. Errors that landmarks
/// share (the datum, the scale) belong in `cov`; then a few displaced landmarks cannot pass as many
/// that stay, nor the other way around.
///
/// @param positions   Where the landmarks were, in one frame. [m]
/// @param difference  Stacked (x, y). [m]
/// @param cov         Joint covariance of the differences if nothing was displaced, positive
///                    definite. [m²]
/// @return Per landmark its cluster, from 0, or kNotDisplaced. Deterministic.
std::vector<int> FindDisplaced(const std::vector<Eigen::Vector2d>& positions,
                               const Eigen::VectorXd& difference,
                               const Eigen::MatrixXd& cov,
                               const DisplacementOptions& options);

}  // namespace shiftmap

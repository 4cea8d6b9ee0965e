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

  /// How well the scale of the map's covariance is known, as degrees of freedom of its variance
  /// factor.
  double map_variance_dof = 4.0;

  /// What a run's covariance may have to be multiplied by, each as likely as the others: wheels
  /// that slip are no random walk.
  std::array<double, 2> run_variance_factors = {1.0, 4.0};

  /// Error of a position in a map that its covariance does not know of. [m]
  double position_floor_m = 0.03;

  /// A landmark that stands farther from where it was than this many of the last of
  /// sd_displacement_m was displaced, whatever the others did. The normal distribution of
  /// displacements has no tail for it: to it, most landmarks moving together the other way would be
  /// more likely.
  double sure_sds = 3.0;
};

/// Joint covariances of what differences between where landmarks are and where they were are made
/// of if nothing was displaced. [m²]
struct DifferenceCovariance {
  Eigen::MatrixXd run;     ///< Of where they are.
  Eigen::MatrixXd map;     ///< Of where they were.
  Eigen::MatrixXd common;  ///< Of the errors that all share: gauge and scale.

  /// With the variance factors of a run and of a map.
  Eigen::MatrixXd Sum(double run_factor, double map_factor) const {
    return run_factor * run + map_factor * map + common;
  }
};

/// One way in which landmarks may have been displaced.
struct Displacement {
  Clusters clusters;  ///< Numbered from 0.
  double probability = 0.0;

  /// What of the differences all landmarks have in common, stacked (x, y): in what frame they are
  /// and in what scale. [m]
  Eigen::VectorXd common;
};

/// Which landmarks stand elsewhere than they did, decided for all of them at once.
///
/// The model: landmarks of a cluster c are displaced together, by u_c ~ N(0, σ² I). The differences
/// between where landmarks are and where they were are d = B u + e with B the membership and
///
///   e ~ N(0, D),  D = s D_run + v D_map + D_common
///
/// The variance factor v says how wrong the covariances of maps are: ν / v ~ χ²_ν, as in the tests
/// of deformation analysis that use the variance factor that the data have. A run has been judged
/// by its own residuals; it is off by s only where it could not know, and never better than it
/// says. For one s and v,
///
///   log p(d | B) = -½ log|D| - ½ log|I + σ² BᵀΛB| - ½ (dᵀΛd - wᵀ (σ⁻² I + BᵀΛB)⁻¹ w),
///   Λ = D⁻¹,  w = BᵀΛd.
///
/// It is averaged over σ, s and v, and the clusters of the largest posterior are searched: clusters
/// grown from the landmarks that differ most, then single landmarks moved between clusters, until
/// nothing gains. Errors that landmarks share belong in `common`; then a few displaced landmarks
/// cannot pass as many that stay, nor the other way around.
///
/// The posterior is over the partitions that are not a thousand times less likely than the best one
/// (Occam's window; Madigan, Raftery 1994): from the best one, from what else the search grew, and
/// from each of these with a cluster in place of what stayed, single landmarks are moved.
///
/// @param positions   Where the landmarks were, in one frame. [m]
/// @param difference  Stacked (x, y). [m]
/// @param cov         With a positive definite sum.
/// @return By falling probability, one at least. Deterministic.
std::vector<Displacement> FindDisplaced(const std::vector<Eigen::Vector2d>& positions,
                                        const Eigen::VectorXd& difference,
                                        const DifferenceCovariance& cov,
                                        const DisplacementOptions& options);

}  // namespace shiftmap

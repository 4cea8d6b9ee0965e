// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "mapper/alignment/alignment_evidence.h"
#include "mapper/alignment/consensus.h"

namespace shiftmap {

/// A landmark in both maps, for alignments that take landmarks to be independent.
struct PlacedTwice {
  Eigen::Vector2d reference = Eigen::Vector2d::Zero();  ///< [m]
  Eigen::Vector2d other = Eigen::Vector2d::Zero();      ///< [m]
  double variance = 0.0;                                ///< Per axis, both maps. [m²]
};

/// The rigid transform T_reference_other that minimizes Σ w |reference - T other|² / variance, in
/// closed form.
/// @param weights  w, none negative; two of different places positive.
Se2 FitRigid(std::span<const PlacedTwice> landmarks, std::span<const double> weights);

/// A largest set of vertices with edges between every two, by branch and bound: a set whose
/// vertices can be coloured with k colours, no edge within a colour, has no clique of more than k
/// (Tomita and Seki, DMTCS 2003). Of several the first found; ascending.
/// @param neighbours  Per vertex its neighbours, bit k for vertex k: symmetric, 64 at most, none
/// its
///                    own.
std::vector<int> MaximumClique(const std::vector<std::uint64_t>& neighbours);

/// The weights of landmarks by graduated non-convexity with truncated least squares (Yang,
/// Antonante, Tzoumas and Carlone, RA-L 2020, (14)): 1 or 0 where it has converged.
/// @param bound2  The squared residual, in variances, up to which a landmark is an inlier.
std::vector<double> GraduatedWeights(std::span<const PlacedTwice> landmarks, double bound2);

/// Pairwise consistency maximization (Mangelson et al., ICRA 2018; the idea of CLIPPER, Lusk et
/// al., ICRA 2021): the largest set of landmarks every two of which are as far apart in one map as
/// in the other, by the joint covariances at a chi-square probability of 0.99, and the weighted
/// least squares over it. Nothing if that is fewer than two.
///
/// Precondition of both: point i of one map is the landmark of point i of the other; 64 at most.
/// @param sd_scale  Of the scale between the maps beyond their covariances. [-]
std::optional<Alignment> AlignByPairwiseConsistency(const JointPoints& reference,
                                                    const JointPoints& other,
                                                    double sd_scale);

/// GraduatedWeights() with the bound at a chi-square probability of 0.99 of each landmark's own
/// covariances. Nothing if fewer than two are inliers.
std::optional<Alignment> AlignByGraduatedNonConvexity(const JointPoints& reference,
                                                      const JointPoints& other,
                                                      double sd_scale);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <optional>
#include <vector>

#include "mapper/index.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {

/// A mode in one of two frames that are to be aligned.
struct AlignmentPoint {
  GroupIndex group;  ///< The same for the same signature in both frames.
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  ///< [m]
  Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();       ///< Marginal. [m²]
};

/// Modes of one map, in the order of its joint covariance.
using AlignmentPoints = IndexedVector<ModeIndex, AlignmentPoint>;

/// That a mode of the other map is where one of the reference is: its landmark stayed, or returned.
struct Match {
  GroupIndex group;
  ModeIndex reference;
  ModeIndex other;
};

/// All pairs of modes of one group: by group, those of a mode of the other map one after another.
std::vector<Match> CandidateMatches(const AlignmentPoints& reference, const AlignmentPoints& other);

struct AlignmentOptions {
  /// Fewer agreeing signatures than this are no alignment: two may agree by accident.
  int min_signatures = 3;

  /// Error of a mode's position that its covariance does not know of, in either frame. [m]
  double position_floor_m = 0.015;

  /// Sensors disagree about lengths by up to this share; no rigid transform would make their maps
  /// agree, so agreement is judged with a scale within these bounds. [-]
  double max_scale_error = 0.05;

  /// Chi-square probability at which two positions agree.
  double gate_probability = 0.999;

  /// A run map whose worst mode is known no better than this against the others may be deformed,
  /// and is cut into parts of as many modes: what a vehicle sees within a minute or two. [m]
  double deformed_sd_m = 0.5;
  int part_modes = 24;

  /// Pairs of correspondences tried at most. Of more than 5000, pairs are drawn (seeded), until a
  /// transform with half the supporters of the best would not have been missed.
  int max_pairs = 200000;
};

struct Alignment {
  Se2 T_reference_other;
  std::vector<GroupIndex> signatures;  ///< Groups that agree, ascending.

  /// Where the agreeing positions lie in the reference frame, and how well they hold the alignment.
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();  ///< [m]
  double variance_m2 = 0.0;                            ///< Of the centroid, per axis.
  double variance_rad2 = 0.0;                          ///< Of the rotation about it.

  bool Agrees(GroupIndex group) const {
    return std::binary_search(signatures.begin(), signatures.end(), group);
  }

  /// Variance per axis, due to the alignment, of a position in the reference frame. [m²]
  double PositionVariance(const Eigen::Vector2d& position) const {
    return variance_m2 + variance_rad2 * (position - centroid).squaredNorm();
  }
};

/// Finds the rigid transform under which the most signatures agree: in each frame every mode of a
/// group may be the one that matches, so it works when most landmarks stand elsewhere by now.
///
/// Every pair of correspondences (same group in both frames) whose distances agree proposes a
/// transform, and least squares over its supporters refines it. The most likely one wins: a
/// supporter at squared distance d² (in variances σ²) is worth log(A / 2πσ²) - d²/2 against a
/// landmark that stands anywhere in the area A. One more supporter is therefore not worth any price
/// in the fit of the others.
///
/// Nothing is returned if fewer than min_signatures agree, or none of those that do tell the
/// rotation. Deterministic.
std::optional<Alignment> AlignByConsensus(const AlignmentPoints& reference,
                                          const AlignmentPoints& other,
                                          const AlignmentOptions& options);

/// The same with A given [m²], so that `reference` need hold no groups but those of `other`.
std::optional<Alignment> AlignByConsensus(const AlignmentPoints& reference,
                                          const AlignmentPoints& other,
                                          double area_m2,
                                          const AlignmentOptions& options);

std::vector<Eigen::Vector2d> PositionsOf(const AlignmentPoints& points);

/// The area of the box around all positions, at least a square metre. [m²]
double OccupiedArea(const std::vector<Eigen::Vector2d>& positions);

}  // namespace shiftmap

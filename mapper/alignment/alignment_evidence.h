// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <numbers>

#include "mapper/alignment/consensus.h"
#include "mapper/alignment/match_set.h"
#include "mapper/alignment/move_prior.h"

namespace shiftmap {

inline constexpr double kTwoPi = 2.0 * std::numbers::pi;

/// Modes of a map with their joint covariance.
struct JointPoints {
  AlignmentPoints points;
  Eigen::MatrixXd covariance;  ///< In the order of the points, (x, y) each. [m²]
};

/// A transform from the reference to the other map, with the difference of their scales.
struct SimilarityFit {
  double yaw_rad = 0.0;
  double log_scale = 0.0;
  Eigen::Vector2d centre_reference = Eigen::Vector2d::Zero();  ///< Goes to centre_other. [m]
  Eigen::Vector2d centre_other = Eigen::Vector2d::Zero();      ///< [m]

  /// Of (centre_other, yaw_rad, log_scale).
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();

  Eigen::Vector2d operator*(const Eigen::Vector2d& p_reference) const;
};

/// How well a set of matches explains the other map.
struct SetScore {
  SimilarityFit fit;
  double log_evidence = 0.0;                       ///< Of the positions of landmarks that stayed.
  IndexedVector<LandmarkIndex, double> log_moved;  ///< Of its position if it moved; 0 if it stayed.
  double log_score = 0.0;                          ///< Of all positions and the prior.
};

/// Scores which landmarks stayed between two maps, by the marginal likelihood of the other map's
/// positions (mapper/METHOD.md, 6).
///
/// Threads: const-safe. `reference`, `other` and `prior` must outlive it.
class AlignmentEvidence {
 public:
  /// Groups with a mode in both maps take part. One with several in the other map, where it moved
  /// while that was made, is as many landmarks.
  /// @param area_m2  That the reference takes. [m²]
  AlignmentEvidence(const JointPoints& reference,
                    const JointPoints& other,
                    double area_m2,
                    const MovePrior& prior);

  /// Per landmark its group, ascending.
  const IndexedVector<LandmarkIndex, GroupIndex>& groups() const { return groups_; }

  const IndexedVector<MatchIndex, Match>& matches() const { return matches_; }

  LandmarkIndex LandmarkOf(MatchIndex match) const { return landmarks_[match]; }
  GroupIndex GroupOf(MatchIndex match) const { return matches_[match].group; }
  IndexRange<MatchIndex> MatchesOf(LandmarkIndex landmark) const { return of_landmark_[landmark]; }

  /// log of how many modes of the reference the landmark of a match may be at.
  double LogModes(MatchIndex match) const;

  const Eigen::Vector2d& PositionInReference(MatchIndex match) const {
    return reference_.points[matches_[match].reference].position;
  }
  const Eigen::Vector2d& PositionInOther(MatchIndex match) const {
    return other_.points[matches_[match].other].position;
  }

  /// The matches that rule a match out, and itself: those of its landmark, and those with its mode
  /// of the reference.
  const MatchSet& Rivals(MatchIndex match) const { return rivals_[match]; }

  /// Mean variance per axis of a match's difference, the maps' errors taken as independent. [m²]
  double Variance(MatchIndex match) const;

  /// log of the prior that `stayed` >= 2 of the landmarks stayed, just these.
  double LogStaying(int stayed) const;

  /// log density of a difference r from where a landmark would be had it stayed.
  /// @param cov_r  Of r had it stayed. [m²]
  double LogMovedBy(const Eigen::Vector2d& r, const Eigen::Matrix2d& cov_r) const;

  const MovePrior& prior() const { return prior_; }
  double log_area() const { return log_area_; }
  double log_anywhere() const { return log_anywhere_; }
  double LogAllAnywhere() const { return static_cast<double>(groups_.size()) * log_anywhere_; }

  /// Precondition: at least two matches in range, none a rival of another; kMaxMatches at most.
  SetScore Score(const MatchSet& stayed) const { return Score(stayed, nullptr); }

  /// @param gains  Per match about what adding it, or taking it out, does to log_score; minus
  ///               infinity where a rival is in the set. May be null.
  SetScore Score(const MatchSet& stayed, IndexedVector<MatchIndex, double>* gains) const;

 private:
  friend class SetEvaluation;

  const JointPoints& reference_;
  const JointPoints& other_;
  const MovePrior& prior_;
  double log_area_;
  double log_anywhere_;  // Of a landmark that moved, and not near.
  IndexedVector<LandmarkIndex, GroupIndex> groups_;
  IndexedVector<MatchIndex, Match> matches_;
  IndexedVector<MatchIndex, LandmarkIndex> landmarks_;
  IndexedVector<LandmarkIndex, IndexRange<MatchIndex>> of_landmark_;
  IndexedVector<MatchIndex, MatchSet> rivals_;
};

/// log Γ(x). (std::lgamma writes a global, and threads would race for it.)
double LogGamma(double x);

/// log of n! / (k! (n - k)!).
double LogChoose(double n, double k);

}  // namespace shiftmap

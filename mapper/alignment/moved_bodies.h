// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/alignment/alignment_evidence.h"
#include "mapper/alignment/rigid_bodies.h"

namespace shiftmap {

/// Landmarks that agree with each other, and may have moved as one rigid body.
struct Body {
  MatchSet matches;
  SimilarityFit fit;          ///< Of the body from the reference to the other map.
  double log_evidence = 0.0;  ///< log density of its positions, were it anywhere.
  double scattered = 0.0;     ///< RigidBodies::ScatteredShare().
};

/// What stayed between two maps, and what did not.
struct StayedLandmarks {
  MatchSet matches;
  const SimilarityFit* fit = nullptr;  ///< Null: nothing stayed, and where bodies went is unknown.
  ///< log density of a position if its landmark moved alone.
  IndexedVector<LandmarkIndex, double> log_moved;
};

/// Bodies that moved, beside what stayed.
///
/// `evidence`, `rigid`, `stayed` and the bodies must outlive it.
class MovedBodies {
 public:
  /// None.
  MovedBodies(const AlignmentEvidence& evidence,
              const RigidBodies& rigid,
              const StayedLandmarks& stayed)
      : e_(&evidence), rigid_(&rigid), stayed_(&stayed) {}

  /// These, and one more of other landmarks. Where two bodies changed places, the move of the
  /// second is the inverse of that of the first.
  MovedBodies With(const Body& body) const;

  /// log of the prior that just those stayed and just these moved as bodies, and of how much
  /// likelier that makes the positions than if each landmark had moved alone.
  double LogScore() const;

  const std::vector<MatchSet>& matches() const { return matches_; }

 private:
  double LogWent(const Body& body) const;
  double LogExchanged(const Body& a, const Body& b) const;

  const AlignmentEvidence* e_;
  const RigidBodies* rigid_;
  const StayedLandmarks* stayed_;
  std::vector<MatchSet> matches_;
  std::vector<const Body*> bodies_;
  std::vector<double> log_went_;  // Of each alone.
  double log_gain_ = 0.0;
};

}  // namespace shiftmap

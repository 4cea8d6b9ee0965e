// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/alignment/alignment_evidence.h"

namespace shiftmap {

/// Landmarks that stand on one rigid body, a rack for instance: where they stand close together in
/// the reference says so before anything moves (mapper/METHOD.md, 6).
///
/// Threads: const-safe. `evidence` must outlive it.
class RigidBodies {
 public:
  /// Fewer matches do not show that they moved together: any two landmarks and any transform agree.
  static constexpr int kMinSize = 3;

  explicit RigidBodies(const AlignmentEvidence& evidence);

  /// Sets of landmarks that are likely to be one body each, disjoint.
  const std::vector<MatchSet>& clusters() const { return clusters_; }

  /// log prior that just `stayed` stayed, and that of the others just `moved` did so as bodies.
  /// Where no landmarks stand close together and none moved as a body that is
  /// AlignmentEvidence::LogStaying().
  double LogStaying(const MatchSet& stayed, const std::vector<MatchSet>& moved) const;

  /// The same if nothing stayed, but for the prior of that: each body moves.
  double LogAllMoved(const std::vector<MatchSet>& moved) const;

  /// log probability that the landmarks of kMinSize matches and more are one body, by where they
  /// stand in the reference.
  double LogProbability(const MatchSet& body) const;

  /// Probability that the landmarks of a body stand anywhere and are displaced together, by where
  /// they stand in the reference. A scattered body does not turn.
  double ScatteredShare(const MatchSet& body) const;

 private:
  double LogCompact(const std::vector<MatchIndex>& members) const;
  double LogWeight(const MatchSet& body) const;
  void FindClusters();

  // That are not taken, itself first.
  std::vector<MatchIndex> NearestTo(MatchIndex match, const MatchSet& taken) const;

  const AlignmentEvidence& e_;
  const MovePrior& prior_;
  int landmarks_;
  std::vector<MatchSet> clusters_;
  std::vector<double> weights_;            // Of clusters_, against that there is no such body.
  std::vector<double> log_probabilities_;  // LogProbability() of clusters_.
};

}  // namespace shiftmap

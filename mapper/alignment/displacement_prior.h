// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/index.h"

namespace shiftmap {

struct DisplacementPriorOptions {
  /// Probability that landmarks were displaced: each alone, or a first one of several together.
  double probability_displaced = 0.1;

  /// Probability that a landmark went along with another that was displaced, if it stands next to
  /// it. What moves together stood together: a rack, a row of barriers.
  double probability_with_neighbour = 0.5;

  /// How many landmarks went along wherever they stand, on average.
  double others_anywhere = 0.5;

  /// What is next to a landmark, in units of the median distance of landmarks to their nearest.
  double neighbourhood = 3.0;
};

/// Per landmark the cluster that it was displaced with, or kNotDisplaced.
using Clusters = IndexedVector<LandmarkIndex, int>;
inline constexpr int kNotDisplaced = -1;

/// How likely landmarks are to be displaced together, before their positions are compared.
///
/// Of n landmarks, one at distance r of a displaced one goes along with probability
///
///   p(r) = p_any + (p_neighbour - p_any) exp(-(r / L)²),  p_any = others / n,
///
/// and stays with 1 - p(r), r to the nearest that was displaced. A cluster is as likely as the most
/// likely tree that it may have grown along: p_displaced Π p(r) over the edges of its minimum
/// spanning tree. With C clusters a landmark goes along with each of them with p(r) / C.
///
/// That landmarks stay has to count: among hundreds there are always some that are off to one side,
/// and there are very many ways to choose them.
class DisplacementPrior {
 public:
  /// @param positions  Of all landmarks, in one frame. [m]
  DisplacementPrior(const std::vector<Eigen::Vector2d>& positions,
                    const DisplacementPriorOptions& options);

  /// log Pr of clusters. Empty ones do not count.
  double LogProbability(const Clusters& clusters) const;

 private:
  using Members = std::vector<LandmarkIndex>;

  double Along(LandmarkIndex i, LandmarkIndex j) const { return along_(i.value(), j.value()); }
  double LogTree(const Members& members, double clusters) const;
  double LogStaying(const std::vector<Members>& clusters, const Members& staying) const;

  double log_displaced_;
  Eigen::MatrixXd along_;  // p(r) for every two landmarks.
};

}  // namespace shiftmap

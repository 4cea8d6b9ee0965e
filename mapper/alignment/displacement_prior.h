// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace shiftmap {

struct DisplacementPriorOptions {
  /// Probability that landmarks were displaced: each alone, or a first one of several together.
  double probability_displaced = 0.05;

  /// Probability that a landmark went along with another that was displaced, if it stands next to
  /// it, and if it stands far away. What moves together stood together: a rack, a row of barriers.
  double probability_with_neighbour = 0.5;
  double probability_with_any = 0.1;

  /// What is next to a landmark, in units of the median distance of landmarks to their nearest.
  double neighbourhood = 3.0;
};

/// How likely landmarks are to be displaced together, before their positions are compared.
///
/// A landmark at distance r of a displaced one goes along with probability
///
///   p(r) = p_any + (p_neighbour - p_any) exp(-(r / L)²),
///
/// and a cluster is as likely as the most likely tree that it may have grown along:
/// p_displaced Π p(r) over the edges of its minimum spanning tree.
class DisplacementPrior {
 public:
  /// @param positions  Of all landmarks, in one frame. [m]
  DisplacementPrior(const std::vector<Eigen::Vector2d>& positions,
                    const DisplacementPriorOptions& options);

  /// log Pr of a cluster. Precondition: it has a member.
  double LogProbability(const std::vector<std::size_t>& members) const;

 private:
  double LogProbabilityAlong(double distance_m) const;

  std::vector<Eigen::Vector2d> positions_;
  DisplacementPriorOptions options_;
  double length_m_ = 0.0;  // L.
};

}  // namespace shiftmap

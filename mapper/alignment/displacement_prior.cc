// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/displacement_prior.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "mapstore/core/median.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

// Median over all positions of the distance to the nearest other one; 0 if there is none. [m]
double MedianSpacing(const std::vector<Eigen::Vector2d>& positions) {
  if (positions.size() < 2) return 0.0;
  std::vector<double> nearest(positions.size(), kFar);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    for (std::size_t j = i + 1; j < positions.size(); ++j) {
      const double distance = (positions[i] - positions[j]).norm();
      nearest[i] = std::min(nearest[i], distance);
      nearest[j] = std::min(nearest[j], distance);
    }
  }
  return Median(std::move(nearest));
}

}  // namespace

DisplacementPrior::DisplacementPrior(const std::vector<Eigen::Vector2d>& positions,
                                     const DisplacementPriorOptions& options)
    : positions_(positions),
      options_(options),
      length_m_(options.neighbourhood * MedianSpacing(positions)) {}

double DisplacementPrior::LogProbability(const std::vector<std::size_t>& members) const {
  SHIFTMAP_CHECK(!members.empty(), "cluster without members");
  double log_probability = std::log(options_.probability_displaced);
  // The tree of Prim: what is nearest to it is next.
  std::vector<std::size_t> outside(members.begin() + 1, members.end());
  std::vector<double> to_tree(outside.size(), kFar);
  std::size_t newest = members.front();
  while (!outside.empty()) {
    for (std::size_t i = 0; i < outside.size(); ++i) {
      to_tree[i] = std::min(to_tree[i], (positions_[outside[i]] - positions_[newest]).norm());
    }
    const auto next = std::min_element(to_tree.begin(), to_tree.end()) - to_tree.begin();
    log_probability += LogProbabilityAlong(to_tree[static_cast<std::size_t>(next)]);
    newest = outside[static_cast<std::size_t>(next)];
    outside.erase(outside.begin() + next);
    to_tree.erase(to_tree.begin() + next);
  }
  return log_probability;
}

double DisplacementPrior::LogProbabilityAlong(double distance_m) const {
  const double ratio = length_m_ > 0.0 ? distance_m / length_m_ : 0.0;
  return std::log(options_.probability_with_any +
                  (options_.probability_with_neighbour - options_.probability_with_any) *
                      std::exp(-ratio * ratio));
}

}  // namespace shiftmap

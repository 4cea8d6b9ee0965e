// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/displacement_prior.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "mapstore/core/median.h"

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

// The logarithm of a product of many factors, hardly ever more than one logarithm.
class LogProduct {
 public:
  void operator*=(double factor) {
    product_ *= factor;
    if (product_ > kSmall) return;
    log_ += std::log(product_);
    product_ = 1.0;
  }

  double Log() const { return log_ + std::log(product_); }

 private:
  static constexpr double kSmall = 1e-200;

  double product_ = 1.0;
  double log_ = 0.0;
};

}  // namespace

DisplacementPrior::DisplacementPrior(const std::vector<Eigen::Vector2d>& positions,
                                     const DisplacementPriorOptions& options)
    : log_displaced_(std::log(options.probability_displaced)),
      along_(std::ssize(positions), std::ssize(positions)) {
  const double next_to = options.probability_with_neighbour;
  const double anywhere =
      std::min(next_to, options.others_anywhere / static_cast<double>(positions.size()));
  const double length = options.neighbourhood * MedianSpacing(positions);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    for (std::size_t j = 0; j < positions.size(); ++j) {
      const double ratio = length > 0.0 ? (positions[i] - positions[j]).norm() / length : 0.0;
      along_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
          anywhere + (next_to - anywhere) * std::exp(-ratio * ratio);
    }
  }
}

double DisplacementPrior::LogProbability(const Clusters& clusters) const {
  std::vector<Members> members;
  Members staying;
  for (const LandmarkIndex i : clusters.indices()) {
    if (clusters[i] == kNotDisplaced) {
      staying.push_back(i);
      continue;
    }
    const auto cluster = static_cast<std::size_t>(clusters[i]);
    if (cluster >= members.size()) members.resize(cluster + 1);
    members[cluster].push_back(i);
  }
  std::erase_if(members, [](const Members& cluster) { return cluster.empty(); });
  double log_probability = 0.0;
  for (const Members& cluster : members) {
    log_probability += LogTree(cluster, static_cast<double>(members.size()));
  }
  return log_probability + LogStaying(members, staying);
}

double DisplacementPrior::LogTree(const Members& members, double clusters) const {
  // The tree of Prim: what is likeliest to go along with it is next.
  Members outside(members.begin() + 1, members.end());
  std::vector<double> to_tree(outside.size());
  LogProduct probability;
  LandmarkIndex newest = members.front();
  while (!outside.empty()) {
    for (std::size_t i = 0; i < outside.size(); ++i) {
      to_tree[i] = std::max(to_tree[i], Along(outside[i], newest));
    }
    const auto next = static_cast<std::size_t>(std::max_element(to_tree.begin(), to_tree.end()) -
                                               to_tree.begin());
    probability *= to_tree[next] / clusters;
    newest = outside[next];
    outside[next] = outside.back();
    to_tree[next] = to_tree.back();
    outside.pop_back();
    to_tree.pop_back();
  }
  return log_displaced_ + probability.Log();
}

double DisplacementPrior::LogStaying(const std::vector<Members>& clusters,
                                     const Members& staying) const {
  const auto count = static_cast<double>(clusters.size());
  LogProduct probability;
  for (const LandmarkIndex i : staying) {
    for (const Members& cluster : clusters) {
      double along = 0.0;
      for (const LandmarkIndex member : cluster) along = std::max(along, Along(member, i));
      probability *= 1.0 - along / count;
    }
  }
  return probability.Log();
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/leaf_reduction.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Squared Mahalanobis distance of two poses that count as one, κ² of T-IV (26).
constexpr double kSamePose = 0.05;

bool SameHypothesis(const Leaf& a, const Leaf& b, const std::function<bool(int)>& must_agree) {
  bool all_equal = true;
  for (std::size_t i = 0; i < a.beliefs.size(); ++i) {
    if (a.beliefs[i].resolved == b.beliefs[i].resolved) continue;
    if (must_agree(a.beliefs[i].group)) return false;
    all_equal = false;
  }
  if (all_equal) return true;
  const PoseWithCovariance pose_a = a.filter.Pose();
  const PoseWithCovariance pose_b = b.filter.Pose();
  const Eigen::Vector3d d = (pose_a.T_map_vehicle.Inverse() * pose_b.T_map_vehicle).Log();
  const Eigen::Matrix3d cov = pose_a.cov_T_map_vehicle + pose_b.cov_T_map_vehicle;
  return d.dot(cov.inverse() * d) < kSamePose;
}

// Adds the lighter leaf `from` to `into`.
void Absorb(const Leaf& from, Leaf* into) {
  const double log_weight = LogAdd(into->log_weight, from.log_weight);
  const double share_into = into->log_weight - log_weight;
  const double share_from = from.log_weight - log_weight;
  for (std::size_t i = 0; i < into->beliefs.size(); ++i) {
    GroupBelief& belief = into->beliefs[i];
    const GroupBelief& other = from.beliefs[i];
    if (belief.resolved == other.resolved && belief.resolved != GroupBelief::kUnresolved) continue;
    Eigen::VectorXd mixed(belief.log_p.size());
    for (int state = 0; state < mixed.size(); ++state) {
      mixed[state] = LogAdd(share_into + belief.LogProbability(state),
                            share_from + other.LogProbability(state));
    }
    belief.log_p = mixed;
    belief.resolved = GroupBelief::kUnresolved;
  }
  into->log_weight = log_weight;
}

void SortByWeight(std::vector<Leaf>* leaves) {
  std::stable_sort(leaves->begin(), leaves->end(), [](const Leaf& a, const Leaf& b) {
    return a.log_weight > b.log_weight;
  });
}

void RemoveImpossible(std::vector<Leaf>* leaves) {
  std::erase_if(*leaves, [](const Leaf& leaf) { return leaf.log_weight == kLogZero; });
  SHIFTMAP_CHECK(!leaves->empty(), "no leaf left");
}

}  // namespace

double NormalizeWeights(std::vector<Leaf>* leaves) {
  double total = kLogZero;
  for (const Leaf& leaf : *leaves) total = LogAdd(total, leaf.log_weight);
  for (Leaf& leaf : *leaves) leaf.log_weight -= total;
  return total;
}

Eigen::VectorXd MarginalLogProbability(const std::vector<Leaf>& leaves, std::size_t index) {
  Eigen::VectorXd marginal =
      Eigen::VectorXd::Constant(leaves.front().beliefs[index].log_p.size(), kLogZero);
  for (const Leaf& leaf : leaves) {
    for (int state = 0; state < marginal.size(); ++state) {
      marginal[state] =
          LogAdd(marginal[state], leaf.log_weight + leaf.beliefs[index].LogProbability(state));
    }
  }
  return marginal;
}

void MergeLeaves(const std::function<bool(int group)>& must_agree, std::vector<Leaf>* leaves) {
  SortByWeight(leaves);
  std::vector<Leaf> kept;
  for (Leaf& leaf : *leaves) {
    const auto same = std::find_if(kept.begin(), kept.end(), [&](const Leaf& other) {
      return SameHypothesis(other, leaf, must_agree);
    });
    if (same == kept.end()) {
      kept.push_back(std::move(leaf));
    } else {
      Absorb(leaf, &*same);
    }
  }
  SortByWeight(&kept);
  *leaves = std::move(kept);
}

double KeepHeaviest(int max_leaves, double min_weight, std::vector<Leaf>* leaves) {
  SortByWeight(leaves);
  const double log_min = std::log(min_weight);
  double dropped = 0.0;
  while (leaves->size() > static_cast<std::size_t>(max_leaves) ||
         (leaves->size() > 1 && leaves->back().log_weight < log_min)) {
    dropped += std::exp(leaves->back().log_weight);
    leaves->pop_back();
  }
  NormalizeWeights(leaves);
  return dropped;
}

void ConditionOn(std::size_t index, int state, std::vector<Leaf>* leaves) {
  for (Leaf& leaf : *leaves) {
    GroupBelief& belief = leaf.beliefs[index];
    leaf.log_weight += belief.LogProbability(state);
    belief.resolved = state;
  }
  RemoveImpossible(leaves);
}

void Exclude(std::size_t index, int state, std::vector<Leaf>* leaves) {
  for (Leaf& leaf : *leaves) {
    GroupBelief& belief = leaf.beliefs[index];
    if (belief.resolved == state) {
      leaf.log_weight = kLogZero;
    } else if (belief.resolved == GroupBelief::kUnresolved) {
      belief.log_p[state] = kLogZero;
      const double left = LogSumExp(belief.log_p);
      leaf.log_weight += left;
      if (left != kLogZero) belief.log_p.array() -= left;
    }
  }
  RemoveImpossible(leaves);
}

}  // namespace shiftmap

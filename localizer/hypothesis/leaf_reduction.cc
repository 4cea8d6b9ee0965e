// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/leaf_reduction.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Squared Mahalanobis distances of two poses that count as one, κ² of T-IV (26). Leaves with one
// assignment have seen the same modes, and their poses differ by what each took for a false alarm:
// a leaf that took a false alarm for the mode must not replace the one that did not.
constexpr double kSamePose = 0.05;
constexpr double kSamePoseOfOneAssignment = 1.0;

// Equal for leaves that agree where they must: spares most comparisons of two leaves.
std::uint64_t AgreementKey(const Leaf& leaf, const std::vector<bool>& must_agree) {
  std::uint64_t key = 0;
  for (std::size_t i = 0; i < leaf.beliefs.size(); ++i) {
    constexpr std::uint64_t kOddFactor = 0x9E3779B97F4A7C15;
    if (must_agree[i])
      key = (key + static_cast<std::uint64_t>(leaf.beliefs[i].resolved)) * kOddFactor;
  }
  return key;
}

bool SameHypothesis(const Leaf& a, const Leaf& b, const std::vector<bool>& must_agree) {
  bool all_equal = true;
  for (std::size_t i = 0; i < a.beliefs.size(); ++i) {
    if (a.beliefs[i].resolved == b.beliefs[i].resolved) continue;
    if (must_agree[i]) return false;
    all_equal = false;
  }
  const PoseWithCovariance pose_a = a.filter.Pose();
  const PoseWithCovariance pose_b = b.filter.Pose();
  const Eigen::Matrix3d cov = pose_a.cov_T_map_vehicle + pose_b.cov_T_map_vehicle;
  return SquaredMahalanobis(pose_a.T_map_vehicle, pose_b.T_map_vehicle, cov) <
         (all_equal ? kSamePoseOfOneAssignment : kSamePose);
}

// Of the places that two leaves remember for a group the likelier stays.
// @param log_into, log_from  Probabilities of `absent`.
void MergePlaces(double log_into,
                 double log_from,
                 const Leaf& from,
                 const GroupBelief& other,
                 Leaf* into,
                 GroupBelief* belief) {
  const double total = LogAdd(log_into, log_from);
  if (total == kLogZero) return;
  const double share_into = std::exp(log_into - total) * belief->place_probability;
  const double share_from = std::exp(log_from - total) * other.place_probability;
  const UnknownPlace* const place =
      share_from > share_into ? from.filter.FindPlace(other.group) : nullptr;
  belief->place_probability = place ? share_from : share_into;
  if (!place) return;
  into->filter.AdoptPlace(*place);
  belief->log_missed[0] = other.log_missed[0];
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
    MergePlaces(share_into + belief.LogProbability(0),
                share_from + other.LogProbability(0),
                from,
                other,
                into,
                &belief);
    for (int state = 0; state < belief.states(); ++state) {
      belief.log_p[static_cast<std::size_t>(state)] = LogAdd(
          share_into + belief.LogProbability(state), share_from + other.LogProbability(state));
    }
    belief.resolved = GroupBelief::kUnresolved;
  }
  into->log_weight = log_weight;
}

void RemoveImpossible(LeafSet* leaves) {
  for (Leaf* leaf : leaves->Rebuild()) {
    if (leaf->log_weight == kLogZero) {
      leaves->Drop(leaf);
    } else {
      leaves->Keep(leaf);
    }
  }
  SHIFTMAP_CHECK(!leaves->empty(), "no leaf left");
}

}  // namespace

double NormalizeWeights(LeafSet* leaves) {
  double total = kLogZero;
  for (const Leaf* leaf : leaves->all()) total = LogAdd(total, leaf->log_weight);
  for (Leaf* leaf : leaves->all()) leaf->log_weight -= total;
  return total;
}

StateValues MarginalLogProbability(const LeafSet& leaves, std::size_t index) {
  StateValues marginal(leaves.front().beliefs[index].log_p.size(), kLogZero);
  for (const Leaf* leaf : leaves.all()) {
    const GroupBelief& belief = leaf->beliefs[index];
    for (int state = 0; state < belief.states(); ++state) {
      double& sum = marginal[static_cast<std::size_t>(state)];
      sum = LogAdd(sum, leaf->log_weight + belief.LogProbability(state));
    }
  }
  return marginal;
}

void MergeLeaves(const std::vector<bool>& must_agree, LeafSet* leaves) {
  if (leaves->size() == 1) return;
  leaves->SortByWeight();
  for (Leaf* leaf : leaves->all()) leaf->agreement_key = AgreementKey(*leaf, must_agree);
  for (Leaf* leaf : leaves->Rebuild()) {
    const auto kept = leaves->all();
    const auto same = std::find_if(kept.begin(), kept.end(), [&](const Leaf* other) {
      return other->agreement_key == leaf->agreement_key &&
             SameHypothesis(*other, *leaf, must_agree);
    });
    if (same == kept.end()) {
      leaves->Keep(leaf);
    } else {
      Absorb(*leaf, *same);
      leaves->Drop(leaf);
    }
  }
  leaves->SortByWeight();
}

double KeepHeaviest(int max_leaves, double min_weight, LeafSet* leaves) {
  leaves->SortByWeight();
  const double log_min = std::log(min_weight);
  double dropped = 0.0;
  while (leaves->size() > static_cast<std::size_t>(max_leaves) ||
         (leaves->size() > 1 && leaves->back().log_weight < log_min)) {
    dropped += std::exp(leaves->back().log_weight);
    leaves->PopBack();
  }
  NormalizeWeights(leaves);
  return dropped;
}

void Exclude(std::size_t index, int state, LeafSet* leaves) {
  for (Leaf* leaf : leaves->all()) {
    GroupBelief& belief = leaf->beliefs[index];
    if (belief.resolved == state) {
      leaf->log_weight = kLogZero;
    } else if (belief.resolved == GroupBelief::kUnresolved) {
      belief.log_p[static_cast<std::size_t>(state)] = kLogZero;
      const double left = LogSumExp(AsVector(belief.log_p));
      leaf->log_weight += left;
      if (left != kLogZero) AsVector(belief.log_p).array() -= left;
    }
  }
  RemoveImpossible(leaves);
}

}  // namespace shiftmap

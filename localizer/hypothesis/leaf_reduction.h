// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "localizer/hypothesis/leaf.h"
#include "localizer/hypothesis/leaf_set.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {

/// Shifts the weights so that they sum to 1; returns the log of their sum before.
template <class LeafType>
double NormalizeWeights(LeafSet<LeafType>* leaves) {
  double total = kLogZero;
  for (const LeafType* leaf : leaves->all()) total = LogAdd(total, leaf->log_weight);
  for (LeafType* leaf : leaves->all()) leaf->log_weight -= total;
  return total;
}

/// Log-probability per state of the belief at `index`, over all leaves.
/// Precondition: weights sum to 1.
template <class LeafType>
StateValues MarginalLogProbability(const LeafSet<LeafType>& leaves, std::size_t index) {
  StateValues marginal(leaves.front().beliefs[index].log_p.size(), kLogZero);
  for (const LeafType* leaf : leaves.all()) {
    const GroupBelief& belief = leaf->beliefs[index];
    for (int state = 0; state < belief.states(); ++state) {
      double& sum = marginal[static_cast<std::size_t>(state)];
      sum = LogAdd(sum, leaf->log_weight + belief.LogProbability(state));
    }
  }
  return marginal;
}

/// How far two filters' estimates are apart, squared, as if they were independent: (26) of T-IV,
/// of the poses. A filter that estimates more has an overload.
template <class Filter>
double SquaredDistance(const Filter& a, const Filter& b) {
  const PoseWithCovariance pose_a = a.Pose();
  const PoseWithCovariance pose_b = b.Pose();
  return SquaredMahalanobis(pose_a.T_map_vehicle,
                            pose_b.T_map_vehicle,
                            pose_a.cov_T_map_vehicle + pose_b.cov_T_map_vehicle);
}

namespace leaf_reduction_internal {

// Squared distances of two estimates that count as one, κ² of T-IV (26). Leaves with one
// assignment have seen the same modes, and their poses differ by what each took for a false alarm:
// a leaf that took a false alarm for the mode must not replace the one that did not.
inline constexpr double kSamePose = 0.05;
inline constexpr double kSamePoseOfOneAssignment = 1.0;

// Equal for leaves that agree where they must: spares most comparisons of two leaves.
template <class LeafType>
std::uint64_t AgreementKey(const LeafType& leaf, const std::vector<bool>& must_agree) {
  std::uint64_t key = 0;
  for (std::size_t i = 0; i < leaf.beliefs.size(); ++i) {
    constexpr std::uint64_t kOddFactor = 0x9E3779B97F4A7C15;
    if (must_agree[i])
      key = (key + static_cast<std::uint64_t>(leaf.beliefs[i].resolved)) * kOddFactor;
  }
  return key;
}

template <class LeafType>
bool SameHypothesis(const LeafType& a, const LeafType& b, const std::vector<bool>& must_agree) {
  bool all_equal = true;
  for (std::size_t i = 0; i < a.beliefs.size(); ++i) {
    if (a.beliefs[i].resolved == b.beliefs[i].resolved) continue;
    if (must_agree[i]) return false;
    all_equal = false;
  }
  return SquaredDistance(a.filter, b.filter) < (all_equal ? kSamePoseOfOneAssignment : kSamePose);
}

}  // namespace leaf_reduction_internal

/// Merges leaves that stand for the same hypothesis: weights add, the rest is up to Absorb(). The
/// same hypothesis: equal resolved states for every group and poses that are the same within their
/// uncertainty; or equal states where `must_agree` holds and poses that are the same within a
/// fraction of it, T-IV (26).
/// @param must_agree  By belief.
template <class LeafType>
void MergeLeaves(const std::vector<bool>& must_agree, LeafSet<LeafType>* leaves) {
  namespace internal = leaf_reduction_internal;
  if (leaves->size() == 1) return;
  leaves->SortByWeight();
  for (LeafType* leaf : leaves->all()) {
    leaf->agreement_key = internal::AgreementKey(*leaf, must_agree);
  }
  for (LeafType* leaf : leaves->Rebuild()) {
    const auto kept = leaves->all();
    const auto same = std::find_if(kept.begin(), kept.end(), [&](const LeafType* other) {
      return other->agreement_key == leaf->agreement_key &&
             internal::SameHypothesis(*other, *leaf, must_agree);
    });
    if (same == kept.end()) {
      leaves->Keep(leaf);
      continue;
    }
    LeafType* const into = *same;
    const double log_weight = LogAdd(into->log_weight, leaf->log_weight);
    Absorb(into->log_weight - log_weight, leaf->log_weight - log_weight, *leaf, into);
    into->log_weight = log_weight;
    leaves->Drop(leaf);
  }
  leaves->SortByWeight();
}

/// Keeps the `max_leaves` heaviest leaves, none lighter than `min_weight`; returns the probability
/// mass that went, in [0, 1).
/// Precondition: weights sum to 1; min_weight < 1 / leaves->size(). They do so again after it.
template <class LeafType>
double KeepHeaviest(int max_leaves, double min_weight, LeafSet<LeafType>* leaves) {
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

/// Takes a state of the belief at `index` out of all leaves.
/// Precondition: some leaf has another one. Weights do not sum to 1 after it.
template <class LeafType>
void Exclude(std::size_t index, int state, LeafSet<LeafType>* leaves) {
  for (LeafType* leaf : leaves->Rebuild()) {
    GroupBelief& belief = leaf->beliefs[index];
    if (belief.resolved == state) {
      leaf->log_weight = kLogZero;
    } else if (belief.resolved == GroupBelief::kUnresolved) {
      belief.log_p[static_cast<std::size_t>(state)] = kLogZero;
      leaf->log_weight += Normalize(&belief);
    }
    if (leaf->log_weight == kLogZero) {
      leaves->Drop(leaf);
    } else {
      leaves->Keep(leaf);
    }
  }
  SHIFTMAP_CHECK(!leaves->empty(), "no leaf left");
}

}  // namespace shiftmap

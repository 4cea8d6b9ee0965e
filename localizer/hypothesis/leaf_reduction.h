// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <vector>

#include "localizer/hypothesis/leaf.h"

namespace shiftmap {

/// Shifts the weights so that they sum to 1; returns the log of their sum before.
double NormalizeWeights(std::vector<Leaf>* leaves);

/// Log-probability per state of the belief at `index`, over all leaves.
/// Precondition: weights sum to 1.
Eigen::VectorXd MarginalLogProbability(const std::vector<Leaf>& leaves, std::size_t index);

/// Merges leaves that stand for the same hypothesis: the heavier one's filter stays, weights add,
/// unresolved beliefs mix. The same hypothesis: equal resolved states for every group, or equal
/// for the groups of `must_agree` and poses that are the same within a fraction of their
/// uncertainty, T-IV (26).
void MergeLeaves(const std::function<bool(int group)>& must_agree, std::vector<Leaf>* leaves);

/// Keeps the `max_leaves` heaviest leaves, none lighter than `min_weight`; returns the probability
/// mass that went, in [0, 1).
/// Precondition: weights sum to 1; min_weight < 1 / leaves->size(). They do so again after it.
double KeepHeaviest(int max_leaves, double min_weight, std::vector<Leaf>* leaves);

/// Conditions all leaves on a state of the belief at `index`. Leaves that exclude it go.
/// Precondition: some leaf does not exclude it. Weights do not sum to 1 after it.
void ConditionOn(std::size_t index, int state, std::vector<Leaf>* leaves);

/// Takes a state of the belief at `index` out of all leaves.
/// Precondition: some leaf has another one. Weights do not sum to 1 after it.
void Exclude(std::size_t index, int state, std::vector<Leaf>* leaves);

}  // namespace shiftmap

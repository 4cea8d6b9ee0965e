// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "localizer/hypothesis/leaf_set.h"

namespace shiftmap {

/// Shifts the weights so that they sum to 1; returns the log of their sum before.
double NormalizeWeights(LeafSet* leaves);

/// Log-probability per state of the belief at `index`, over all leaves.
/// Precondition: weights sum to 1.
StateValues MarginalLogProbability(const LeafSet& leaves, std::size_t index);

/// Merges leaves that stand for the same hypothesis: the heavier one's filter stays, weights add,
/// unresolved beliefs mix. The same hypothesis: equal resolved states for every group and poses
/// that are the same within their uncertainty; or equal states where `must_agree` holds and poses
/// that are the same within a fraction of it, T-IV (26).
/// @param must_agree  By belief.
void MergeLeaves(const std::vector<bool>& must_agree, LeafSet* leaves);

/// Keeps the `max_leaves` heaviest leaves, none lighter than `min_weight`; returns the probability
/// mass that went, in [0, 1).
/// Precondition: weights sum to 1; min_weight < 1 / leaves->size(). They do so again after it.
double KeepHeaviest(int max_leaves, double min_weight, LeafSet* leaves);

/// Takes a state of the belief at `index` out of all leaves.
/// Precondition: some leaf has another one. Weights do not sum to 1 after it.
void Exclude(std::size_t index, int state, LeafSet* leaves);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
//
// Selectors that decide every step by itself.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "mapper/selection/mode_sequence.h"

namespace shiftmap {

/// Nearest neighbour, IJRR (22): the state of largest log p(z_t | δ_t) at every step, with negative
/// information (28) where nothing is seen. Of equal ones a random one, as in IJRR 8.2.3.
/// Determinism: by `seed`.
std::vector<int> NearestNeighborModes(const ModeSequenceProblem& problem, std::uint64_t seed);

/// Max-mixture, IJRR (14): the state of largest log w_k + log p(z_t | δ_t = k), with the initial
/// distribution as the mixture's weights w. Without negative information: a step at which nothing
/// is seen has no factor, and keeps the state before it. Of equal ones the smallest state.
std::vector<int> MaxMixtureModes(const ModeSequenceProblem& problem);

/// The posterior of IJRR (23) at every step, T x n, of which EM as printed, "winner takes all",
/// takes the LargestPerStep(): the chain's prior p(δ_t), (5), which knows no other observation,
/// times p(z_t | δ_t), normalized.
Eigen::MatrixXd ExpectationPosteriors(const ModeSequenceProblem& problem);

/// The column of the largest entry of every row; of equal ones the first.
std::vector<int> LargestPerStep(const Eigen::MatrixXd& scores);

}  // namespace shiftmap

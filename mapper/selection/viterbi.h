// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

namespace shiftmap {

/// One group's mode sequence as a hidden Markov chain, IJRR (19): T visits, n states.
struct ModeSequenceProblem {
  Eigen::VectorXd log_initial;                  ///< n: log Pr(δ_1).
  std::vector<Eigen::MatrixXd> log_transition;  ///< T - 1 of n x n: rows = from.
  Eigen::MatrixXd log_likelihood;               ///< T x n: log p(z_t | δ_t).
};

/// Log of the joint probability of a sequence and the observations.
double LogJoint(const ModeSequenceProblem& problem, const std::vector<int>& states);

/// The sequence that maximizes LogJoint: exact, by dynamic programming in O(T n²). Of equal ones
/// the one with the smallest states, last visit first.
std::vector<int> MostLikelyModes(const ModeSequenceProblem& problem);

}  // namespace shiftmap

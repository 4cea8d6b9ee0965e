// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

namespace shiftmap {

/// One group's mode sequence as a hidden Markov chain, IJRR (19): T steps, n states. A step is a
/// visit, or one observation where IJRR's experiments are repeated.
///
/// Probabilities are natural logarithms; -∞ is allowed, +∞ and NaN are not.
struct ModeSequenceProblem {
  Eigen::VectorXd log_initial;                  ///< n: log Pr(δ_1).
  std::vector<Eigen::MatrixXd> log_transition;  ///< T - 1 of n x n: rows = from.

  /// T x n: log p(z_t | δ_t), for z_t = ∅ that of seeing nothing. Any constant may be added to a
  /// row.
  Eigen::MatrixXd log_likelihood;

  /// Steps with z_t = ∅, IJRR (28); empty if there are none.
  std::vector<bool> missed;

  /// The state that a map with one position per landmark would have: IJRR's NOHYP.
  int static_state = 0;

  int steps() const { return static_cast<int>(log_likelihood.rows()); }
  int states() const { return static_cast<int>(log_initial.size()); }
  bool IsMissed(int step) const {
    return !missed.empty() && missed[static_cast<std::size_t>(step)];
  }

  /// log ψ of IJRR (11) without constants: what going from `from` to `to` adds at a step to the
  /// joint. At step 0 the state before does not matter.
  double LogFactor(int step, int from, int to) const;
};

/// Log of the joint probability of a sequence and the observations: the objective of IJRR (19).
double LogJoint(const ModeSequenceProblem& problem, const std::vector<int>& states);

/// Aborts unless the sizes of a problem fit together and it has a step and a state.
void CheckModeSequence(const ModeSequenceProblem& problem);

}  // namespace shiftmap

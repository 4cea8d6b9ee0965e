// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/mode_sequence.h"

#include "proto/core/check.h"

namespace shiftmap {

double ModeSequenceProblem::LogFactor(int step, int from, int to) const {
  const double log_prior =
      step == 0 ? log_initial[to] : log_transition[static_cast<std::size_t>(step) - 1](from, to);
  return log_prior + log_likelihood(step, to);
}

double LogJoint(const ModeSequenceProblem& problem, const std::vector<int>& states) {
  double sum = problem.log_initial[states.front()];
  for (std::size_t t = 0; t < states.size(); ++t) {
    if (t > 0) sum += problem.log_transition[t - 1](states[t - 1], states[t]);
    sum += problem.log_likelihood(static_cast<Eigen::Index>(t), states[t]);
  }
  return sum;
}

void CheckModeSequence(const ModeSequenceProblem& problem) {
  const Eigen::Index steps = problem.log_likelihood.rows();
  const Eigen::Index n = problem.log_initial.size();
  SHIFTMAP_CHECK(steps > 0 && n > 0 && problem.log_likelihood.cols() == n &&
                     static_cast<Eigen::Index>(problem.log_transition.size()) + 1 == steps,
                 "{} steps, {} states",
                 steps,
                 n);
  SHIFTMAP_CHECK(
      problem.missed.empty() || static_cast<Eigen::Index>(problem.missed.size()) == steps,
      "{} flags for {} steps",
      problem.missed.size(),
      steps);
  SHIFTMAP_CHECK(problem.static_state >= 0 && problem.static_state < n,
                 "static state {} of {}",
                 problem.static_state,
                 n);
  for (const Eigen::MatrixXd& transition : problem.log_transition) {
    SHIFTMAP_CHECK(transition.rows() == n && transition.cols() == n,
                   "transition {} x {}, expected {}",
                   transition.rows(),
                   transition.cols(),
                   n);
  }
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/viterbi.h"

#include <Eigen/Core>
#include <utility>

namespace shiftmap {

std::vector<int> MostLikelyModes(const ModeSequenceProblem& problem) {
  CheckModeSequence(problem);
  const Eigen::Index steps = problem.log_likelihood.rows();
  const Eigen::Index n = problem.log_initial.size();
  Eigen::VectorXd best = problem.log_initial + problem.log_likelihood.row(0).transpose();
  Eigen::MatrixXi from(steps, n);
  for (Eigen::Index t = 1; t < steps; ++t) {
    const Eigen::MatrixXd& transition = problem.log_transition[static_cast<std::size_t>(t) - 1];
    Eigen::VectorXd next(n);
    for (Eigen::Index to = 0; to < n; ++to) {
      Eigen::Index argmax = 0;
      next[to] = (best + transition.col(to)).maxCoeff(&argmax) + problem.log_likelihood(t, to);
      from(t, to) = static_cast<int>(argmax);
    }
    best = std::move(next);
  }
  std::vector<int> states(static_cast<std::size_t>(steps));
  Eigen::Index state = 0;
  best.maxCoeff(&state);
  for (Eigen::Index t = steps - 1; t >= 0; --t) {
    states[static_cast<std::size_t>(t)] = static_cast<int>(state);
    if (t > 0) state = from(t, state);
  }
  return states;
}

}  // namespace shiftmap

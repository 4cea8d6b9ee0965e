// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/viterbi.h"

#include "proto/core/check.h"

namespace shiftmap {

double LogJoint(const ModeSequenceProblem& problem, const std::vector<int>& states) {
  double sum = problem.log_initial[states.front()];
  for (std::size_t t = 0; t < states.size(); ++t) {
    if (t > 0) sum += problem.log_transition[t - 1](states[t - 1], states[t]);
    sum += problem.log_likelihood(static_cast<Eigen::Index>(t), states[t]);
  }
  return sum;
}

std::vector<int> MostLikelyModes(const ModeSequenceProblem& problem) {
  const Eigen::Index visits = problem.log_likelihood.rows();
  const Eigen::Index n = problem.log_initial.size();
  SHIFTMAP_CHECK(problem.log_likelihood.cols() == n &&
                     static_cast<Eigen::Index>(problem.log_transition.size()) + 1 == visits,
                 "{} visits, {} states",
                 visits,
                 n);
  Eigen::VectorXd best = problem.log_initial + problem.log_likelihood.row(0).transpose();
  Eigen::MatrixXi from(visits, n);
  for (Eigen::Index t = 1; t < visits; ++t) {
    const Eigen::MatrixXd& transition = problem.log_transition[static_cast<std::size_t>(t) - 1];
    Eigen::VectorXd next(n);
    for (Eigen::Index to = 0; to < n; ++to) {
      Eigen::Index argmax = 0;
      next[to] = (best + transition.col(to)).maxCoeff(&argmax) + problem.log_likelihood(t, to);
      from(t, to) = static_cast<int>(argmax);
    }
    best = std::move(next);
  }
  std::vector<int> states(static_cast<std::size_t>(visits));
  Eigen::Index state = 0;
  best.maxCoeff(&state);
  for (Eigen::Index t = visits - 1; t >= 0; --t) {
    states[static_cast<std::size_t>(t)] = static_cast<int>(state);
    if (t > 0) state = from(t, state);
  }
  return states;
}

}  // namespace shiftmap

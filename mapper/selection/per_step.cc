// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/per_step.h"

#include <random>

#include "localizer/hypothesis/log_math.h"

namespace shiftmap {

std::vector<int> NearestNeighborModes(const ModeSequenceProblem& problem, std::uint64_t seed) {
  CheckModeSequence(problem);
  std::mt19937_64 random(seed);
  std::vector<int> states;
  for (int t = 0; t < problem.steps(); ++t) {
    const double largest = problem.log_likelihood.row(t).maxCoeff();
    std::vector<int> equal;
    for (int state = 0; state < problem.states(); ++state) {
      if (problem.log_likelihood(t, state) == largest) equal.push_back(state);
    }
    states.push_back(equal.size() == 1 ? equal.front() : equal[random() % equal.size()]);
  }
  return states;
}

std::vector<int> MaxMixtureModes(const ModeSequenceProblem& problem) {
  CheckModeSequence(problem);
  const Eigen::MatrixXd weighted =
      problem.log_likelihood.rowwise() + problem.log_initial.transpose();
  std::vector<int> states = LargestPerStep(weighted);
  int before = LargestPerStep(problem.log_initial.transpose()).front();
  for (int t = 0; t < problem.steps(); ++t) {
    int& state = states[static_cast<std::size_t>(t)];
    if (problem.IsMissed(t)) state = before;
    before = state;
  }
  return states;
}

Eigen::MatrixXd ExpectationPosteriors(const ModeSequenceProblem& problem) {
  CheckModeSequence(problem);
  const Eigen::Index steps = problem.log_likelihood.rows();
  const Eigen::Index n = problem.log_initial.size();
  Eigen::MatrixXd posteriors(steps, n);
  Eigen::VectorXd log_prior = problem.log_initial;
  for (Eigen::Index t = 0; t < steps; ++t) {
    if (t > 0) {
      const Eigen::MatrixXd& transition = problem.log_transition[static_cast<std::size_t>(t) - 1];
      const Eigen::VectorXd before = log_prior;
      for (Eigen::Index to = 0; to < n; ++to) {
        log_prior[to] = LogSumExp(before + transition.col(to));
      }
    }
    const Eigen::VectorXd score = log_prior + problem.log_likelihood.row(t).transpose();
    posteriors.row(t) = (score.array() - LogSumExp(score)).exp().transpose();
  }
  return posteriors;
}

std::vector<int> LargestPerStep(const Eigen::MatrixXd& scores) {
  std::vector<int> states;
  for (Eigen::Index t = 0; t < scores.rows(); ++t) {
    Eigen::Index state = 0;
    scores.row(t).maxCoeff(&state);
    states.push_back(static_cast<int>(state));
  }
  return states;
}

}  // namespace shiftmap

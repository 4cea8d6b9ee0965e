// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/mapper/selection/random_sequence.h"

#include <cmath>

#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

Eigen::VectorXd LogDistribution(std::mt19937_64& random, int n) {
  return RandomDistribution(random, n).array().log();
}

}  // namespace

ModeSequenceProblem RandomSequence(std::mt19937_64& random, int n, int steps, double spread) {
  std::normal_distribution<double> normal;
  ModeSequenceProblem problem;
  problem.log_initial = LogDistribution(random, n);
  for (int t = 1; t < steps; ++t) {
    Eigen::MatrixXd transition(n, n);
    for (int row = 0; row < n; ++row) transition.row(row) = LogDistribution(random, n).transpose();
    problem.log_transition.push_back(transition);
  }
  problem.log_likelihood.resize(steps, n);
  for (double& value : problem.log_likelihood.reshaped()) value = spread * normal(random);
  return problem;
}

ModeSequenceProblem RandomSequenceWithTies(std::mt19937_64& random, int n, int steps) {
  std::uniform_int_distribution<int> entry(-2, 0);
  ModeSequenceProblem problem;
  problem.log_initial.resize(n);
  for (double& value : problem.log_initial) value = entry(random);
  for (int t = 1; t < steps; ++t) {
    Eigen::MatrixXd transition(n, n);
    for (double& value : transition.reshaped()) value = entry(random);
    problem.log_transition.push_back(transition);
  }
  problem.log_likelihood.resize(steps, n);
  for (double& value : problem.log_likelihood.reshaped()) value = entry(random);
  return problem;
}

ModeSequenceProblem StickySequence(std::mt19937_64& random,
                                   const std::vector<int>& truth,
                                   int n,
                                   double change_probability,
                                   double separation) {
  std::normal_distribution<double> normal;
  ModeSequenceProblem problem;
  problem.log_initial = Eigen::VectorXd::Constant(n, -std::log(n));
  Eigen::MatrixXd transition = Eigen::MatrixXd::Constant(n, n, change_probability / (n - 1));
  transition.diagonal().setConstant(1.0 - change_probability);
  problem.log_transition.assign(truth.size() - 1, transition.array().log().matrix());
  problem.log_likelihood.resize(static_cast<Eigen::Index>(truth.size()), n);
  // The states are corners of a regular simplex with edges of `separation`.
  const double edge = separation / std::sqrt(2.0);
  for (std::size_t t = 0; t < truth.size(); ++t) {
    for (int k = 0; k < n; ++k) {
      const double z = (k == truth[t] ? edge : 0.0) + normal(random);
      problem.log_likelihood(static_cast<Eigen::Index>(t), k) = edge * z;
    }
  }
  return problem;
}

}  // namespace shiftmap::testing

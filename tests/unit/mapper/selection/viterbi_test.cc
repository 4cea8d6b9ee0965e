// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/viterbi.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

Eigen::VectorXd LogDistribution(std::mt19937_64& random, int n) {
  return testing::RandomDistribution(random, n).array().log();
}

ModeSequenceProblem RandomProblem(std::mt19937_64& random, int n, int visits) {
  std::normal_distribution<double> normal;
  ModeSequenceProblem problem;
  problem.log_initial = LogDistribution(random, n);
  for (int t = 1; t < visits; ++t) {
    Eigen::MatrixXd transition(n, n);
    for (int row = 0; row < n; ++row) transition.row(row) = LogDistribution(random, n).transpose();
    problem.log_transition.push_back(transition);
  }
  problem.log_likelihood.resize(visits, n);
  for (double& value : problem.log_likelihood.reshaped()) value = 2.0 * normal(random);
  return problem;
}

// Calls `visit` with every sequence of `length` states out of n.
template <typename Visit>
void ForEachSequence(int n, int length, Visit visit) {
  std::vector<int> states(static_cast<std::size_t>(length), 0);
  while (true) {
    visit(states);
    std::size_t digit = 0;
    while (digit < states.size() && ++states[digit] == n) states[digit++] = 0;
    if (digit == states.size()) return;
  }
}

TEST(Viterbi, NoOtherSequenceIsMoreLikely) {
  std::mt19937_64 random(testing::TestSeed(11));
  for (int trial = 0; trial < 60; ++trial) {
    const int n = 1 + trial % 4;
    const int visits = 1 + trial % 7;
    const ModeSequenceProblem problem = RandomProblem(random, n, visits);
    double best = -std::numeric_limits<double>::infinity();
    ForEachSequence(n, visits, [&](const std::vector<int>& states) {
      best = std::max(best, LogJoint(problem, states));
    });
    EXPECT_NEAR(LogJoint(problem, MostLikelyModes(problem)), best, 1e-12) << trial;
  }
}

TEST(Viterbi, TheJointSumsToTheEvidenceOfTheForwardRecursion) {
  std::mt19937_64 random(testing::TestSeed(12));
  for (int n = 1; n <= 4; ++n) {
    const ModeSequenceProblem problem = RandomProblem(random, n, 5);
    double sum = 0.0;
    ForEachSequence(
        n, 5, [&](const std::vector<int>& states) { sum += std::exp(LogJoint(problem, states)); });
    Eigen::VectorXd forward =
        (problem.log_initial + problem.log_likelihood.row(0).transpose()).array().exp();
    for (Eigen::Index t = 1; t < 5; ++t) {
      const Eigen::MatrixXd transition =
          problem.log_transition[static_cast<std::size_t>(t - 1)].array().exp();
      forward = (transition.transpose() * forward).array() *
                problem.log_likelihood.row(t).transpose().array().exp();
    }
    EXPECT_NEAR(sum / forward.sum(), 1.0, 1e-12) << n;
  }
}

TEST(Viterbi, OfEqualSequencesTheOneWithTheSmallestStates) {
  ModeSequenceProblem problem;
  problem.log_initial = Eigen::Vector3d::Zero();
  problem.log_transition.assign(3, Eigen::Matrix3d::Zero());
  problem.log_likelihood = Eigen::MatrixXd::Zero(4, 3);
  EXPECT_EQ(MostLikelyModes(problem), std::vector<int>(4, 0));
}

TEST(Viterbi, AStickyChainOutvotesOneWeakVisit) {
  ModeSequenceProblem problem;
  problem.log_initial = Eigen::Vector2d::Constant(std::log(0.5));
  Eigen::Matrix2d sticky;
  sticky << 0.99, 0.01, 0.01, 0.99;
  problem.log_transition.assign(2, sticky.array().log());
  problem.log_likelihood.resize(3, 2);
  problem.log_likelihood << 0.0, -5.0, -2.0, 0.0, 0.0, -5.0;
  EXPECT_EQ(MostLikelyModes(problem), (std::vector<int>{0, 0, 0}));
  problem.log_likelihood(1, 0) = -20.0;
  EXPECT_EQ(MostLikelyModes(problem), (std::vector<int>{0, 1, 0}));
}

}  // namespace
}  // namespace shiftmap

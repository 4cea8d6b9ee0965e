// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/viterbi.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "tests/support/random_map.h"
#include "tests/unit/mapper/selection/random_sequence.h"

namespace shiftmap {
namespace {

using testing::ForEachSequence;
using testing::RandomSequence;
using testing::RandomSequenceWithTies;

// Lengths at which brute force still ends: n^T <= 1e5.
int LongestCheckable(int n) {
  if (n == 1) return 40;
  int steps = 0;
  for (double sequences = n; sequences <= 1e5; sequences *= n) ++steps;
  return steps;
}

double BestByBruteForce(const ModeSequenceProblem& problem) {
  double best = -std::numeric_limits<double>::infinity();
  ForEachSequence(problem.states(), problem.steps(), [&](const std::vector<int>& states) {
    best = std::max(best, LogJoint(problem, states));
  });
  return best;
}

TEST(Viterbi, NoOtherSequenceIsMoreLikelyInAnyChainThatCanBeEnumerated) {
  std::mt19937_64 random(testing::TestSeed(11));
  int chains = 0;
  for (int n = 1; n <= 12; ++n) {
    for (int steps = 1; steps <= LongestCheckable(n); ++steps) {
      const double spread = chains % 2 == 0 ? 2.0 : 0.3;
      const ModeSequenceProblem problem = RandomSequence(random, n, steps, spread);
      EXPECT_NEAR(LogJoint(problem, MostLikelyModes(problem)), BestByBruteForce(problem), 1e-12)
          << n << " states, " << steps << " steps";
      ++chains;
    }
  }
  EXPECT_GT(chains, 80);
}

TEST(Viterbi, TiesAreBrokenTowardsTheSmallestStatesLastStepFirst) {
  std::mt19937_64 random(testing::TestSeed(13));
  for (int trial = 0; trial < 200; ++trial) {
    const int n = 2 + trial % 3;
    const int steps = 1 + trial % 6;
    const ModeSequenceProblem problem = RandomSequenceWithTies(random, n, steps);
    const double best = BestByBruteForce(problem);
    // Enumerated with the last step as the most significant digit, the first best one is it.
    std::vector<int> expected;
    ForEachSequence(n, steps, [&](const std::vector<int>& states) {
      if (expected.empty() && LogJoint(problem, states) == best) expected = states;
    });
    EXPECT_EQ(MostLikelyModes(problem), expected) << trial;
  }
}

TEST(Viterbi, TheJointSumsToTheEvidenceOfTheForwardRecursion) {
  std::mt19937_64 random(testing::TestSeed(12));
  for (int n = 1; n <= 4; ++n) {
    const ModeSequenceProblem problem = RandomSequence(random, n, 5);
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

TEST(Viterbi, TakesNoImpossibleStep) {
  ModeSequenceProblem problem;
  constexpr double kNever = -std::numeric_limits<double>::infinity();
  problem.log_initial = Eigen::Vector2d(0.0, kNever);
  Eigen::Matrix2d one_way;
  one_way << std::log(0.5), std::log(0.5), kNever, 0.0;
  problem.log_transition.assign(2, one_way);
  problem.log_likelihood.resize(3, 2);
  problem.log_likelihood << -50.0, 0.0, -50.0, 0.0, 0.0, -1.0;
  EXPECT_EQ(MostLikelyModes(problem), (std::vector<int>{0, 1, 1}));
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/forward_backward.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "mapper/selection/per_step.h"
#include "mapper/selection/viterbi.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/unit/mapper/selection/random_sequence.h"

namespace shiftmap {
namespace {

using testing::ForEachSequence;
using testing::IsNearMatrix;
using testing::RandomSequence;

TEST(SmoothModes, AreTheMarginalsOfAllSequences) {
  std::mt19937_64 random(testing::TestSeed(21));
  for (int trial = 0; trial < 40; ++trial) {
    const int n = 1 + trial % 4;
    const int steps = 1 + trial % 7;
    const ModeSequenceProblem problem = RandomSequence(random, n, steps);
    Eigen::MatrixXd marginals = Eigen::MatrixXd::Zero(steps, n);
    ForEachSequence(n, steps, [&](const std::vector<int>& states) {
      const double joint = std::exp(LogJoint(problem, states));
      for (int t = 0; t < steps; ++t) marginals(t, states[static_cast<std::size_t>(t)]) += joint;
    });
    const double evidence = marginals.row(0).sum();
    const ModePosteriors posteriors = SmoothModes(problem);
    EXPECT_THAT(posteriors.probabilities, IsNearMatrix(marginals / evidence, 1e-12)) << trial;
    EXPECT_NEAR(posteriors.log_evidence, std::log(evidence), 1e-10) << trial;
  }
}

// What comes later does not count: the last step of the chain cut off behind it.
TEST(ForwardPosteriors, AreTheMarginalsOfAllSequencesUpToTheStep) {
  std::mt19937_64 random(testing::TestSeed(24));
  for (int trial = 0; trial < 40; ++trial) {
    const int n = 1 + trial % 4;
    const int steps = 1 + trial % 7;
    const ModeSequenceProblem problem = RandomSequence(random, n, steps);
    Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(steps, n);
    for (int t = 0; t < steps; ++t) {
      ModeSequenceProblem cut = problem;
      cut.log_transition.resize(static_cast<std::size_t>(t));
      cut.log_likelihood = problem.log_likelihood.topRows(t + 1);
      ForEachSequence(n, t + 1, [&](const std::vector<int>& states) {
        expected(t, states.back()) += std::exp(LogJoint(cut, states));
      });
      expected.row(t) /= expected.row(t).sum();
    }
    EXPECT_THAT(ForwardPosteriors(problem), IsNearMatrix(expected, 1e-12)) << trial;
  }
}

TEST(SmoothModes, ALongChainOfSharpLikelihoodsNeitherOverflowsNorUnderflows) {
  std::mt19937_64 random(testing::TestSeed(22));
  const ModeSequenceProblem problem = RandomSequence(random, 5, 2000, 400.0);
  const ModePosteriors posteriors = SmoothModes(problem);
  EXPECT_TRUE(std::isfinite(posteriors.log_evidence));
  EXPECT_THAT(posteriors.probabilities.rowwise().sum().eval(),
              IsNearMatrix(Eigen::VectorXd::Ones(2000), 1e-9));
}

TEST(SmoothModes, WithoutATransitionToSpeakOfEveryStepStandsAlone) {
  std::mt19937_64 random(testing::TestSeed(23));
  ModeSequenceProblem problem = RandomSequence(random, 3, 6);
  problem.log_initial.setConstant(-std::log(3.0));
  for (Eigen::MatrixXd& transition : problem.log_transition) {
    transition.setConstant(-std::log(3.0));
  }
  Eigen::MatrixXd expected = problem.log_likelihood.array().exp();
  for (Eigen::Index t = 0; t < expected.rows(); ++t) expected.row(t) /= expected.row(t).sum();
  EXPECT_THAT(SmoothModes(problem).probabilities, IsNearMatrix(expected, 1e-12));
}

TEST(SmoothModes, TheLargestPerStepHaveTheMostExpectedRightSteps) {
  std::mt19937_64 random(testing::TestSeed(24));
  for (int trial = 0; trial < 20; ++trial) {
    const ModeSequenceProblem problem = RandomSequence(random, 3, 5, 1.0);
    const Eigen::MatrixXd posteriors = SmoothModes(problem).probabilities;
    const auto expected_right = [&](const std::vector<int>& states) {
      double sum = 0.0;
      for (std::size_t t = 0; t < states.size(); ++t) {
        sum += posteriors(static_cast<Eigen::Index>(t), states[t]);
      }
      return sum;
    };
    const double best = expected_right(LargestPerStep(SmoothModes(problem).probabilities));
    ForEachSequence(3, 5, [&](const std::vector<int>& states) {
      EXPECT_LE(expected_right(states), best + 1e-12);
    });
    EXPECT_LE(expected_right(MostLikelyModes(problem)), best + 1e-12);
  }
}

}  // namespace
}  // namespace shiftmap

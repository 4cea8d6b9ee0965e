// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/mcts.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "mapper/selection/viterbi.h"
#include "tests/support/random_map.h"
#include "tests/unit/mapper/selection/random_sequence.h"

namespace shiftmap {
namespace {

using testing::RandomSequence;
using testing::StickySequence;

std::vector<MctsOptions> Variants() {
  MctsOptions model;
  MctsOptions uniform;
  uniform.roll_out = RollOutPolicy::kUniform;
  MctsOptions parallel;
  parallel.trees = 3;
  return {model, uniform, parallel};
}

TEST(MostVisitedModes, AreNeverMoreLikelyThanViterbis) {
  std::mt19937_64 random(testing::TestSeed(41));
  for (int trial = 0; trial < 60; ++trial) {
    const ModeSequenceProblem problem = RandomSequence(random, 1 + trial % 5, 1 + trial % 12);
    const double best = LogJoint(problem, MostLikelyModes(problem));
    for (const MctsOptions& options : Variants()) {
      const std::vector<int> states = MostVisitedModes(problem, options, 1);
      ASSERT_EQ(static_cast<int>(states.size()), problem.steps());
      EXPECT_LE(LogJoint(problem, states), best + 1e-9) << trial;
    }
  }
}

TEST(MostVisitedModes, FindTheOptimumOfEasyChains) {
  std::mt19937_64 random(testing::TestSeed(42));
  for (int trial = 0; trial < 30; ++trial) {
    const ModeSequenceProblem problem = StickySequence(random, {1, 1, 0, 0, 0}, 2, 0.2, 6.0);
    for (const MctsOptions& options : Variants()) {
      EXPECT_EQ(MostVisitedModes(problem, options, 1), MostLikelyModes(problem)) << trial;
    }
  }
}

TEST(MostVisitedModes, WithEnoughIterationsSeeThroughAStepThatMisleads) {
  // The second step is likelier in state 1, but the third makes it a detour.
  ModeSequenceProblem problem;
  problem.log_initial = Eigen::Vector2d::Constant(std::log(0.5));
  Eigen::Matrix2d sticky;
  sticky << 0.9, 0.1, 0.1, 0.9;
  problem.log_transition.assign(2, sticky.array().log());
  problem.log_likelihood.resize(3, 2);
  problem.log_likelihood << 0.0, -3.0, -2.5, 0.0, 0.0, -6.0;
  ASSERT_EQ(MostLikelyModes(problem), (std::vector<int>{0, 0, 0}));
  MctsOptions greedy;
  greedy.depth = 1;
  EXPECT_EQ(MostVisitedModes(problem, greedy, 1), (std::vector<int>{0, 1, 0}));
  EXPECT_EQ(MostVisitedModes(problem, {}, 1), (std::vector<int>{0, 0, 0}));
}

TEST(MostVisitedModes, AreTheSameForTheSameSeed) {
  std::mt19937_64 random(testing::TestSeed(43));
  // Hardly told apart, so that chance decides.
  const ModeSequenceProblem problem = RandomSequence(random, 4, 40, 0.2);
  for (const MctsOptions& options : Variants()) {
    const std::vector<int> states = MostVisitedModes(problem, options, 5);
    EXPECT_EQ(MostVisitedModes(problem, options, 5), states);
    EXPECT_NE(MostVisitedModes(problem, options, 6), states);
  }
}

TEST(MostVisitedModes, MoreIterationsFindBetterSequences) {
  std::mt19937_64 random(testing::TestSeed(44));
  double few_short = 0.0;
  double many_short = 0.0;
  for (int trial = 0; trial < 30; ++trial) {
    const ModeSequenceProblem problem = RandomSequence(random, 3, 12);
    const double best = LogJoint(problem, MostLikelyModes(problem));
    MctsOptions few;
    few.iterations = 10;
    MctsOptions many;
    many.iterations = 1000;
    few_short += best - LogJoint(problem, MostVisitedModes(problem, few, 1));
    many_short += best - LogJoint(problem, MostVisitedModes(problem, many, 1));
  }
  EXPECT_LT(many_short, 0.5 * few_short);
}

TEST(MostVisitedModes, TakeNoImpossibleStep) {
  constexpr double kNever = -std::numeric_limits<double>::infinity();
  ModeSequenceProblem problem;
  problem.log_initial = Eigen::Vector2d(0.0, kNever);
  Eigen::Matrix2d one_way;
  one_way << std::log(0.5), std::log(0.5), kNever, 0.0;
  problem.log_transition.assign(2, one_way);
  problem.log_likelihood.resize(3, 2);
  problem.log_likelihood << -5.0, 0.0, -5.0, 0.0, 0.0, -1.0;
  for (const MctsOptions& options : Variants()) {
    EXPECT_EQ(MostVisitedModes(problem, options, 1), (std::vector<int>{0, 1, 1}));
  }
}

}  // namespace
}  // namespace shiftmap

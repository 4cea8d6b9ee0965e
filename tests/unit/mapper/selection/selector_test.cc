// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/selector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "mapper/selection/forward_backward.h"
#include "mapper/selection/per_step.h"
#include "mapper/selection/viterbi.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/mapper/selection/random_sequence.h"

namespace shiftmap {
namespace {

using testing::IsNearMatrix;
using testing::IsOk;
using testing::RandomSequence;
using testing::StatusIs;

Selection Select(SelectorKind kind, const ModeSequenceProblem& problem) {
  SelectorOptions options;
  options.kind = kind;
  return MakeSelector(options)->Select(problem);
}

// The problem with state k renamed new_name[k].
ModeSequenceProblem Renamed(const ModeSequenceProblem& problem, const std::vector<int>& new_name) {
  ModeSequenceProblem renamed = problem;
  for (int i = 0; i < problem.states(); ++i) {
    const int to = new_name[static_cast<std::size_t>(i)];
    renamed.log_initial[to] = problem.log_initial[i];
    renamed.log_likelihood.col(to) = problem.log_likelihood.col(i);
    for (int j = 0; j < problem.states(); ++j) {
      for (std::size_t t = 0; t < problem.log_transition.size(); ++t) {
        renamed.log_transition[t](to, new_name[static_cast<std::size_t>(j)]) =
            problem.log_transition[t](i, j);
      }
    }
  }
  renamed.static_state = new_name[static_cast<std::size_t>(problem.static_state)];
  return renamed;
}

TEST(Selector, NamesAndKindsAreOneToOne) {
  for (const SelectorKind kind : AllSelectors()) {
    const StatusOr<SelectorKind> parsed = ParseSelector(SelectorName(kind));
    ASSERT_THAT(parsed, IsOk());
    EXPECT_EQ(*parsed, kind);
  }
  EXPECT_THAT(ParseSelector("best"), StatusIs(StatusCode::kInvalidArgument, "selector 'best'"));
}

TEST(Selector, OptionsOutOfRangeAreNamed) {
  SelectorOptions options;
  EXPECT_THAT(options.Validate(), IsOk());
  options.mcts.depth = 0;
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, "mcts depth: 0"));
  options = {};
  options.mcts.exploration = 0.0;
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, "mcts exploration"));
}

TEST(Selector, NoneIsMoreLikelyThanViterbi) {
  std::mt19937_64 random(testing::TestSeed(51));
  for (int trial = 0; trial < 40; ++trial) {
    const ModeSequenceProblem problem = RandomSequence(random, 1 + trial % 4, 1 + trial % 9, 1.0);
    const double best = LogJoint(problem, Select(SelectorKind::kViterbi, problem).states);
    for (const SelectorKind kind : AllSelectors()) {
      const std::vector<int> states = Select(kind, problem).states;
      ASSERT_EQ(static_cast<int>(states.size()), problem.steps()) << SelectorName(kind);
      EXPECT_LE(LogJoint(problem, states), best + 1e-12) << SelectorName(kind);
    }
  }
}

// Names of modes mean nothing.
TEST(Selector, RenamingTheModesRenamesTheSelection) {
  std::mt19937_64 random(testing::TestSeed(52));
  for (int trial = 0; trial < 30; ++trial) {
    // Sharp enough that the search's chance does not decide.
    const ModeSequenceProblem problem = testing::StickySequence(random, {0, 2, 1}, 4, 0.3, 8.0);
    std::vector<int> new_name(4);
    std::iota(new_name.begin(), new_name.end(), 0);
    std::shuffle(new_name.begin(), new_name.end(), random);
    const ModeSequenceProblem renamed = Renamed(problem, new_name);
    for (const SelectorKind kind : AllSelectors()) {
      std::vector<int> expected = Select(kind, problem).states;
      for (int& state : expected) state = new_name[static_cast<std::size_t>(state)];
      EXPECT_EQ(Select(kind, renamed).states, expected) << SelectorName(kind);
    }
  }
}

// Constants that a step adds to all states mean nothing.
TEST(Selector, AConstantPerStepChangesNothing) {
  std::mt19937_64 random(testing::TestSeed(53));
  std::uniform_int_distribution<int> constant(-64, 64);
  for (int trial = 0; trial < 30; ++trial) {
    const ModeSequenceProblem problem =
        testing::StickySequence(random, {0, 0, 2, 2, 1, 1}, 3, 0.05, 6.0);
    ModeSequenceProblem shifted = problem;
    for (Eigen::Index t = 0; t < 6; ++t) {
      shifted.log_likelihood.row(t).array() += constant(random);
    }
    for (const SelectorKind kind : AllSelectors()) {
      const Selection before = Select(kind, problem);
      const Selection after = Select(kind, shifted);
      EXPECT_EQ(after.states, before.states) << SelectorName(kind);
      ASSERT_EQ(after.probabilities.has_value(), before.probabilities.has_value());
      if (!before.probabilities) continue;
      EXPECT_THAT(*after.probabilities, IsNearMatrix(*before.probabilities, 1e-9));
    }
  }
}

TEST(Selector, NoHypothesesIsTheStaticState) {
  std::mt19937_64 random(testing::TestSeed(54));
  ModeSequenceProblem problem = RandomSequence(random, 3, 4);
  problem.static_state = 2;
  EXPECT_EQ(Select(SelectorKind::kNoHypotheses, problem).states, std::vector<int>(4, 2));
}

TEST(Selector, ProbabilitiesAreTheSelectorsOwn) {
  std::mt19937_64 random(testing::TestSeed(55));
  const ModeSequenceProblem problem = RandomSequence(random, 3, 8);
  for (const SelectorKind kind : AllSelectors()) {
    const Selection selection = Select(kind, problem);
    const bool expected = kind == SelectorKind::kEm || kind == SelectorKind::kEmRecursive ||
                          kind == SelectorKind::kMarginal;
    EXPECT_EQ(selection.probabilities.has_value(), expected) << SelectorName(kind);
  }
  EXPECT_THAT(*Select(SelectorKind::kEm, problem).probabilities,
              IsNearMatrix(ExpectationPosteriors(problem), 0.0));
  EXPECT_THAT(*Select(SelectorKind::kEmRecursive, problem).probabilities,
              IsNearMatrix(ForwardPosteriors(problem), 0.0));
  EXPECT_THAT(*Select(SelectorKind::kMarginal, problem).probabilities,
              IsNearMatrix(SmoothModes(problem).probabilities, 0.0));
}

// A landmark that is at three places for ten noisy observations each, IJRR 8.1.
TEST(Selector, TheChainCorrectsWhatSingleObservationsGetWrong) {
  std::mt19937_64 random(testing::TestSeed(56));
  std::vector<int> truth;
  for (int t = 0; t < 30; ++t) truth.push_back(t / 10);
  int viterbi_wrong = 0;
  int marginal_wrong = 0;
  int nearest_wrong = 0;
  const auto wrong = [&](SelectorKind kind, const ModeSequenceProblem& problem) {
    const std::vector<int> states = Select(kind, problem).states;
    int count = 0;
    for (std::size_t t = 0; t < truth.size(); ++t) count += states[t] != truth[t] ? 1 : 0;
    return count;
  };
  for (int trial = 0; trial < 200; ++trial) {
    const ModeSequenceProblem problem = testing::StickySequence(random, truth, 3, 1e-4, 2.0);
    viterbi_wrong += wrong(SelectorKind::kViterbi, problem);
    marginal_wrong += wrong(SelectorKind::kMarginal, problem);
    nearest_wrong += wrong(SelectorKind::kNearestNeighbor, problem);
  }
  EXPECT_LT(2 * viterbi_wrong, nearest_wrong);
  EXPECT_LT(2 * marginal_wrong, nearest_wrong);
}

}  // namespace
}  // namespace shiftmap

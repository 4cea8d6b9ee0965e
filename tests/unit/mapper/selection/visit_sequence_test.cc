// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/visit_sequence.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>

#include "mapper/selection/viterbi.h"
#include "tests/support/geometry_matchers.h"

namespace shiftmap {
namespace {

using testing::IsNearMatrix;

TEST(MakeVisitSequence, TransitionsFollowTheRealTimeBetweenVisits) {
  const ModeChain chain = ModeChain::Uniform(2, 1e-5);
  const Eigen::VectorXd flat = Eigen::Vector3d::Zero();
  const Duration day = std::chrono::hours(24);
  const Duration minute = std::chrono::minutes(1);
  const Stamp begin = StampFromSeconds(1.7e9);
  const Stamp second = begin + minute + std::chrono::seconds(30);
  const ModeSequenceProblem problem =
      MakeVisitSequence(flat,
                        chain,
                        {{flat, begin, begin + minute},
                         {flat, second, second + minute},
                         {flat, second + minute + day, second + 2 * minute + day}});
  ASSERT_EQ(problem.log_transition.size(), 2u);
  for (std::size_t t = 0; t < 2; ++t) {
    const Duration gap = t == 0 ? Duration(std::chrono::seconds(30)) : day;
    EXPECT_THAT(problem.log_transition[t].array().exp().matrix().eval(),
                IsNearMatrix(chain.Transition(gap), 1e-12));
  }
  // Seconds apart the landmark stays; a day apart it may well have moved.
  EXPECT_LT(problem.log_transition[0](0, 1), std::log(1e-3));
  EXPECT_GT(problem.log_transition[1](0, 1), std::log(0.1));
}

TEST(MakeVisitSequence, AChainThatNeverMovesCanStillBeOverruled) {
  const Eigen::VectorXd flat = Eigen::Vector2d::Zero();
  const ModeSequenceProblem problem = MakeVisitSequence(
      flat,
      ModeChain::Uniform(1, 0.0),
      {{Eigen::Vector2d(0.0, -1e4), {}, {}},
       {Eigen::Vector2d(-1e4, 0.0), StampFromSeconds(3600.0), StampFromSeconds(3600.0)}});
  EXPECT_EQ(MostLikelyModes(problem), (std::vector<int>{0, 1}));
}

}  // namespace
}  // namespace shiftmap

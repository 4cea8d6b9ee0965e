// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_steps.h"

#include <gtest/gtest.h>

#include <cmath>

namespace shiftmap::testing {
namespace {

ChainHistory TwoVisits(double end_s, double begin_s) {
  Eigen::VectorXd values(2);
  values << -700.0, -701.0;
  return {Signature("7"),
          2,
          {{StampFromSeconds(end_s - 100.0), StampFromSeconds(end_s), values},
           {StampFromSeconds(begin_s), StampFromSeconds(begin_s + 1.0), values}}};
}

TEST(ChainStepsTest, TimePassesBetweenVisitsOnly) {
  const ChainSteps steps = MakeChainSteps(TwoVisits(1000.0, 1030.0));
  ASSERT_EQ(steps.gaps.size(), 1u);
  EXPECT_EQ(steps.gaps[0].length, FromSeconds(30.0));
  EXPECT_EQ(steps.gap_of_step, (std::vector<int>{-1, 0}));
  EXPECT_DOUBLE_EQ(steps.log_scale, -1400.0);
  EXPECT_DOUBLE_EQ(steps.likelihoods(0, 1), 1.0);
  EXPECT_DOUBLE_EQ(steps.likelihoods(1, 1), std::exp(-1.0));
}

TEST(ChainStepsTest, EqualGapsAreOne) {
  ChainHistory history{Signature("7"), 2, {}};
  for (int i = 0; i < 50; ++i) {
    const Stamp stamp = StampFromSeconds(60.0 * i);
    history.visits.push_back({stamp, stamp, Eigen::VectorXd::Zero(2)});
  }
  EXPECT_EQ(MakeChainSteps(history).gaps.size(), 1u);
}

TEST(ChainStepsTest, GapsOfAboutOneLengthShareTheirMean) {
  ChainHistory history{Signature("7"), 2, {}};
  double now = 0.0;
  for (const double gap : {0.0, 1000.0, 1001.0, 50'000.0, 999.0}) {
    now += gap;
    history.visits.push_back(
        {StampFromSeconds(now), StampFromSeconds(now), Eigen::VectorXd::Zero(2)});
  }
  EXPECT_EQ(MakeChainSteps(history).gaps.size(), 4u);
  const ChainSteps steps = MakeChainSteps(history, {}, 0.02);
  EXPECT_EQ(steps.gap_of_step, (std::vector<int>{-1, 0, 0, 1, 0}));
  ASSERT_EQ(steps.gaps.size(), 2u);
  EXPECT_NEAR(ToSeconds(steps.gaps[0].length), 1000.0, 1e-6);
  EXPECT_NEAR(ToSeconds(steps.gaps[1].length), 50'000.0, 1e-6);
}

TEST(ChainStepsTest, CutsGapsWhereAPhaseOfTheDayEnds) {
  // From 22:30 to 01:15, and the same before the epoch.
  for (const double midnight : {86400.0 * 20, -86400.0 * 3}) {
    const ChainSteps steps =
        MakeChainSteps(TwoVisits(midnight - 5400.0, midnight + 4500.0), {kRhythmDay, 24});
    ASSERT_EQ(steps.gap_of_step.size(), 5u);
    const std::vector<int> phases = {22, 23, 0, 1};
    const std::vector<double> seconds = {1800.0, 3600.0, 3600.0, 900.0};
    for (std::size_t i = 0; i < 4; ++i) {
      const ChainSteps::Gap& gap = steps.gaps[static_cast<std::size_t>(steps.gap_of_step[i + 1])];
      EXPECT_EQ(gap.phase, phases[i]);
      EXPECT_EQ(gap.length, FromSeconds(seconds[i]));
    }
    // Nothing is seen where a gap is cut.
    EXPECT_EQ(steps.likelihoods.col(2), Eigen::Vector2d::Ones());
    EXPECT_LT(steps.likelihoods(1, 4), 1.0);
  }
}

TEST(ChainStepsTest, PhasesThatDoNotDivideTheDayCoverIt) {
  const ChainSteps steps = MakeChainSteps(TwoVisits(0.0, 86400.0), {kRhythmDay, 7});
  Duration total{0};
  for (std::size_t i = 1; i < steps.gap_of_step.size(); ++i) {
    total += steps.gaps[static_cast<std::size_t>(steps.gap_of_step[i])].length;
  }
  EXPECT_EQ(total, FromSeconds(86400.0));
  EXPECT_EQ(steps.gap_of_step.size(), 8u);
}

}  // namespace
}  // namespace shiftmap::testing

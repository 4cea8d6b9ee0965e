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
  // The first phase, as of any gap; then one phase, two, two and one.
  EXPECT_EQ(steps.gap_of_step.size(), 6u);
}

// From 22:30 on a Sunday, 400 days.
TEST(ChainStepsTest, ManyWholePhasesAreFewGaps) {
  constexpr double kBegin = 3.0 * 86400.0 + 22.5 * 3600.0;
  for (const RhythmCalendar& calendar :
       {RhythmCalendar{kRhythmDay, 24}, RhythmCalendar{kRhythmWeek, 168}}) {
    const ChainSteps steps = MakeChainSteps(TwoVisits(kBegin, kBegin + 400.0 * 86400.0), calendar);
    EXPECT_LT(steps.gap_of_step.size(), 26u);
    Duration total{0};
    int phase = calendar.phases - 2;
    for (std::size_t i = 1; i < steps.gap_of_step.size(); ++i) {
      const ChainSteps::Gap& gap = steps.gaps[static_cast<std::size_t>(steps.gap_of_step[i])];
      EXPECT_EQ(gap.phase, phase);
      total += gap.length;
      phase = (phase + (i == 1 ? 1 : static_cast<int>(gap.length / FromSeconds(3600.0)))) %
              calendar.phases;
    }
    EXPECT_EQ(total, FromSeconds(400.0 * 86400.0));
    for (const ChainSteps::Gap& gap : steps.gaps) {
      if (!gap.composed()) continue;
      const ChainSteps::Gap& first = steps.gaps[static_cast<std::size_t>(gap.first)];
      const ChainSteps::Gap& second = steps.gaps[static_cast<std::size_t>(gap.second)];
      EXPECT_EQ(gap.length, first.length + second.length);
      EXPECT_EQ(gap.phase, first.phase);
      EXPECT_EQ(
          (first.phase + static_cast<int>(first.length / FromSeconds(3600.0))) % calendar.phases,
          second.phase);
    }
  }
}

TEST(ChainStepsTest, TheFirstVisitsAreTheStepsUpToTheLastOfThem) {
  ChainHistory history{Signature("7"), 2, {}};
  for (int i = 0; i < 5; ++i) {
    const Stamp stamp = StampFromSeconds(5000.0 * i);
    history.visits.push_back({stamp, stamp, Eigen::Vector2d(-i, -2.0 * i)});
  }
  const RhythmCalendar day{kRhythmDay, 24};
  const ChainSteps first = FirstVisits(MakeChainSteps(history, day), 3);
  const ChainSteps expected = MakeChainSteps(FirstVisits(history, 3), day);
  EXPECT_EQ(first.gap_of_step, expected.gap_of_step);
  EXPECT_EQ(first.likelihoods, expected.likelihoods);
  EXPECT_EQ(first.log_scale, expected.log_scale);
  EXPECT_EQ(first.visits.size(), 3u);
}

}  // namespace
}  // namespace shiftmap::testing

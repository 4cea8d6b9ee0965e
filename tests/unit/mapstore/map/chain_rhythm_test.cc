// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/chain_rhythm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "mapstore/map/mode_chain.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map/rate_matrix.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

using std::chrono::hours;
using ::testing::HasSubstr;

// A Monday, 2024-01-01T00:00Z.
const Stamp kMonday = StampFromSeconds(1704067200.0);

ModeChain WithRhythm(const ModeChain& chain, const ChainRhythm& rhythm) {
  return *chain.WithRhythm(rhythm);
}

// Π from hour to hour, each by a matrix exponential of its own.
Eigen::MatrixXd HourByHour(const ChainRhythm& rhythm, Stamp from, Stamp to) {
  Eigen::MatrixXd transition = Eigen::MatrixXd::Identity(rhythm.states(), rhythm.states());
  while (from < to) {
    const Stamp hour = std::chrono::floor<hours>(from);
    const Stamp end = std::min<Stamp>(to, hour + hours(1));
    const auto since_monday = (hour - kMonday) % rhythm.calendar().period;
    auto phase = std::chrono::duration_cast<hours>(since_monday).count();
    if (phase < 0) phase += rhythm.calendar().phases;
    const Eigen::MatrixXd& rates = rhythm.rate_matrices()[static_cast<std::size_t>(phase)];
    transition = (transition * StochasticExponential(rates, ToSeconds(end - from))).eval();
    from = end;
  }
  return transition;
}

TEST(ChainRhythmTest, TransitionsAreThoseOfTheHoursInBetween) {
  std::mt19937_64 random(TestSeed(91));
  std::uniform_real_distribution<double> begin(-1e8, 1e8);
  for (const Duration period : {kRhythmDay, kRhythmWeek}) {
    const ChainRhythm rhythm = RandomRhythm(random, 4, period);
    for (const double seconds : {0.5, 1800.0, 7200.0, 2e5, 3e6}) {
      const Stamp from = kMonday + FromSeconds(begin(random));
      const Stamp to = from + FromSeconds(seconds);
      EXPECT_THAT(rhythm.Transition(from, to), IsNearMatrix(HourByHour(rhythm, from, to), 1e-11))
          << seconds;
    }
  }
}

TEST(ChainRhythmTest, TransitionsCompose) {
  std::mt19937_64 random(TestSeed(92));
  const ChainRhythm rhythm = RandomRhythm(random, 3, kRhythmWeek);
  const Stamp middle = kMonday + hours(1000) + std::chrono::minutes(17);
  const Stamp end = middle + hours(7 * 24 * 60);
  EXPECT_THAT((rhythm.Transition(kMonday, middle) * rhythm.Transition(middle, end)).eval(),
              IsNearMatrix(rhythm.Transition(kMonday, end), 1e-11));
  EXPECT_EQ(rhythm.Transition(end, middle), Eigen::MatrixXd::Identity(3, 3));
}

TEST(ChainRhythmTest, WithTheSameRatesAtAllHoursItIsTheChainWithout) {
  Eigen::MatrixXd rates(3, 3);
  rates << -3e-5, 1e-5, 2e-5, 4e-6, -5e-6, 1e-6, 2e-4, 0.0, -2e-4;
  const ModeChain chain = *ModeChain::FromRates(rates);
  const ChainRhythm rhythm = *ChainRhythm::Make(kRhythmDay, std::vector(24, rates));
  for (const double seconds : {60.0, 4e4, 9e6, 3e8}) {
    EXPECT_THAT(WithRhythm(chain, rhythm).Transition(kMonday, kMonday + FromSeconds(seconds)),
                IsNearMatrix(chain.Transition(FromSeconds(seconds)), 1e-10))
        << seconds;
  }
}

TEST(ChainRhythmTest, RatesOfSecondsAndCenturiesGiveDistributions) {
  Eigen::MatrixXd rates(2, 2);
  rates << -10.0, 10.0, 30.0, -30.0;
  const ChainRhythm rhythm = *ChainRhythm::Make(kRhythmWeek, std::vector(168, rates));
  for (const Stamp to : {kMonday + hours(1), kMonday + hours(24 * 365 * 200), Stamp::max()}) {
    const Eigen::MatrixXd transition = rhythm.Transition(kMonday, to);
    EXPECT_NEAR(transition(0, 0), 0.75, 1e-12);
    EXPECT_NEAR(transition.row(1).sum(), 1.0, 1e-15);
  }
  EXPECT_NEAR(rhythm.Transition(Stamp::min(), Stamp::max())(1, 1), 0.25, 1e-12);
}

TEST(ChainRhythmTest, TheWeekBeginsOnMonday) {
  const RhythmCalendar week{kRhythmWeek, 168};
  EXPECT_EQ(week.Into(kMonday), Duration(0));
  EXPECT_EQ(week.PhaseOf(week.Into(kMonday - Duration(1))), 167);
  EXPECT_EQ(week.Into(Stamp()), Duration(hours(72)));  // The epoch was a Thursday.
}

TEST(ChainRhythmTest, AFilterGoesByTheHour) {
  std::mt19937_64 random(TestSeed(93));
  LandmarkGroup group = RandomGroup(random, "7", 1);
  Eigen::MatrixXd night(2, 2);
  night << -1e-8, 1e-8, 1e-8, -1e-8;
  Eigen::MatrixXd day(2, 2);
  day << -1e-3, 1e-3, 1e-3, -1e-3;
  std::vector<Eigen::MatrixXd> hours_of_day(24, night);
  std::fill(hours_of_day.begin() + 8, hours_of_day.begin() + 16, day);
  group.chain = WithRhythm(group.chain, *ChainRhythm::Make(kRhythmDay, hours_of_day));
  ModeState state = StationaryStart(group, kMonday);
  AddVisit(
      group, kMonday + hours(18), kMonday + hours(18), 1, {}, Eigen::Vector2d(-50.0, 0.0), &state);
  EXPECT_GT(ProbabilitiesAt(group, state, kMonday + hours(30))(1), 0.99);
  EXPECT_NEAR(ProbabilitiesAt(group, state, kMonday + hours(39))(1), 0.5, 1e-3);
}

TEST(ChainRhythmTest, RefusesBadValues) {
  const Eigen::MatrixXd rates = ModeChain::Uniform(2, 1e-5).rate_matrix();
  EXPECT_THAT(Message(ChainRhythm::Make(hours(12), {rates}).status()),
              HasSubstr("43200 s, expected a day or a week"));
  EXPECT_THAT(Message(ChainRhythm::Make(kRhythmDay, {}).status()), HasSubstr("0 phases"));
  EXPECT_THAT(Message(ChainRhythm::Make(kRhythmDay, {rates, -rates}).status()),
              HasSubstr("phase 1: rate from 0 to 1"));
  EXPECT_THAT(Message(ChainRhythm::Make(kRhythmDay, {rates, Eigen::MatrixXd::Zero(2, 2)}).status()),
              HasSubstr("phase 1: 2 states, expected 3"));
  EXPECT_THAT(
      Message(
          ModeChain::Uniform(1, 1e-5).WithRhythm(*ChainRhythm::Make(kRhythmDay, {rates})).status()),
      HasSubstr("3 states, expected 2"));
}

}  // namespace
}  // namespace shiftmap::testing

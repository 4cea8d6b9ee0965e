// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/learn_rhythm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/support/random_map.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;

constexpr double kDay = 86400.0;
constexpr double kMonday = 4.0 * kDay;

ModeChain Door(double opens_per_day, double closes_per_day) {
  Eigen::MatrixXd rates(2, 2);
  rates << -opens_per_day, opens_per_day, closes_per_day, -closes_per_day;
  return *ModeChain::FromRates(rates / kDay);
}

// From a Monday on.
std::vector<Stamp> Every(double seconds, double total) {
  std::vector<Stamp> stamps;
  for (double now = 0.0; now <= total; now += seconds) {
    stamps.push_back(StampFromSeconds(kMonday + now));
  }
  return stamps;
}

// A chain for each half of a day, by its number.
template <class ChainOfHalf>
ChainPath SimulateHalfDays(ChainOfHalf chain_of_half, int days, std::mt19937_64& random) {
  ChainPath path;
  int state = 0;
  for (int half = 0; half < 2 * days; ++half) {
    const ChainPath part = SimulateChain(chain_of_half(half),
                                         state,
                                         StampFromSeconds(kMonday + 0.5 * kDay * half),
                                         StampFromSeconds(kMonday + 0.5 * kDay * (half + 1)),
                                         random);
    path.since.insert(path.since.end(), part.since.begin(), part.since.end());
    path.states.insert(path.states.end(), part.states.begin(), part.states.end());
    state = part.states.back();
  }
  return path;
}

StatusOr<LearnedRhythm> Learn(const ChainHistory& history) {
  return LearnRhythm(history, LearnChain(history, {})->fit, {}, {});
}

TEST(LearnRhythmTest, TheDaysIsTakenWhereThereIsOne) {
  std::mt19937_64 random(TestSeed(51));
  const ModeChain night = Door(0.5, 10.0);
  const ModeChain day = Door(30.0, 10.0);
  const ChainPath path =
      SimulateHalfDays([&](int half) { return half % 2 == 0 ? night : day; }, 60, random);
  const ChainHistory history = ObservePath(path, 2, Every(600.0, 60.0 * kDay), 0.01, random);
  const StatusOr<LearnedRhythm> learned = Learn(history);
  ASSERT_TRUE(learned.ok());
  ASSERT_TRUE(learned->rhythm);
  EXPECT_GT(learned->held_out_gain, 10.0);
  EXPECT_EQ(learned->rhythm->calendar().period, kRhythmDay);
  double opens_by_night = 0.0;
  double opens_by_day = 0.0;
  for (std::size_t hour = 0; hour < 24; ++hour) {
    const double opens = learned->rhythm->rate_matrices()[hour](0, 1) * kDay;
    (hour < 12 ? opens_by_night : opens_by_day) += opens / 12.0;
  }
  EXPECT_NEAR(opens_by_night, 0.5, 1.0);
  EXPECT_NEAR(opens_by_day, 30.0, 6.0);
}

TEST(LearnRhythmTest, TheWeeksIsTakenWhereDaysDiffer) {
  std::mt19937_64 random(TestSeed(53));
  const ModeChain closed = Door(0.5, 10.0);
  const ModeChain open = Door(30.0, 10.0);
  const auto of_half = [&](int half) {
    return half % 2 == 1 && half / 2 % 7 < 5 ? open : closed;  // By day, from Monday to Friday.
  };
  const ChainPath path = SimulateHalfDays(of_half, 84, random);
  const ChainHistory history = ObservePath(path, 2, Every(1200.0, 84.0 * kDay), 0.01, random);
  const StatusOr<LearnedRhythm> learned = Learn(history);
  ASSERT_TRUE(learned.ok());
  ASSERT_TRUE(learned->rhythm);
  ASSERT_EQ(learned->rhythm->calendar().period, kRhythmWeek);
  const auto opens = [&](int day, int hour) {
    const auto phase = static_cast<std::size_t>(24 * day + hour);
    return learned->rhythm->rate_matrices()[phase](0, 1) * kDay;
  };
  EXPECT_GT(opens(2, 15), 10.0);
  EXPECT_LT(opens(2, 3), 5.0);
  EXPECT_LT(opens(6, 15), 0.6 * opens(2, 15));
}

TEST(LearnRhythmTest, NoneIsTakenWhereThereIsNone) {
  std::mt19937_64 random(TestSeed(52));
  for (int trial = 0; trial < 5; ++trial) {
    const std::vector<Stamp> stamps = Every(1200.0, 40.0 * kDay);
    const ChainPath path = SimulateChain(Door(3.0, 6.0), 0, stamps.front(), stamps.back(), random);
    const StatusOr<LearnedRhythm> learned = Learn(ObservePath(path, 2, stamps, 0.01, random));
    ASSERT_TRUE(learned.ok());
    EXPECT_FALSE(learned->rhythm);
    EXPECT_LT(learned->held_out_gain, 3.0);
  }
}

// A landmark that moves every other week says nothing of hours.
TEST(LearnRhythmTest, NoneIsTakenOfFewJumps) {
  std::mt19937_64 random(TestSeed(54));
  const std::vector<Stamp> stamps = Every(6 * 3600.0, 60.0 * kDay);
  const ModeChain chain = ModeChain::Uniform(1, 1.0 / (14.0 * kDay));
  const ChainPath path = SimulateChain(chain, 0, stamps.front(), stamps.back(), random);
  const StatusOr<LearnedRhythm> learned = Learn(ObservePath(path, 2, stamps, 0.01, random));
  ASSERT_TRUE(learned.ok());
  EXPECT_FALSE(learned->rhythm);
  EXPECT_EQ(learned->held_out_gain, 0.0);
}

TEST(LearnRhythmTest, WithoutVisitsInAPhaseItKeepsTheRatesOfTheDay) {
  ChainHistory history{Signature("7"), 2, {}};
  for (int day = 0; day < 30; ++day) {
    // From 10:00 to 10:30, and the night is one long gap that says little.
    for (const double second : {36000.0, 36600.0, 37200.0, 37800.0}) {
      const Stamp stamp = StampFromSeconds(kDay * day + second);
      history.visits.push_back({stamp, stamp, Eigen::VectorXd::Zero(2)});
    }
  }
  const ModeChain whole = Door(2.0, 3.0);
  for (const ModeChain& chain : FitPhases(history, {kRhythmDay, 24}, std::vector(24, whole), {})) {
    EXPECT_NEAR(chain.rate_matrix()(0, 1) * kDay, 2.0, 1e-2);
    EXPECT_NEAR(chain.rate_matrix()(1, 0) * kDay, 3.0, 1e-2);
  }
}

TEST(LearnRhythmTest, RefusesABadVisitAmongThoseHeldOut) {
  std::mt19937_64 random(TestSeed(43));
  const std::vector<Stamp> stamps = Every(7200.0, 20.0 * kDay);
  const ModeChain chain = ModeChain::Uniform(1, 1e-4);
  ChainHistory history = ObservePath(
      SimulateChain(chain, 1, stamps.front(), stamps.back(), random), 2, stamps, 0.05, random);
  const RateFit fit = LearnChain(history, {})->fit;
  EXPECT_TRUE(LearnRhythm(history, fit, {}, {}).ok());
  history.visits[220].log_likelihoods.resize(0);
  EXPECT_EQ(LearnRhythm(history, fit, {}, {}).status().code(), StatusCode::kInvalidArgument);
}

TEST(LearnRhythmTest, RefusesOptionsOutOfRange) {
  RhythmOptions options;
  options.held_out = 1.0;
  EXPECT_THAT(Message(LearnRhythm({Signature("7"), 2, {}}, {}, {}, options).status()),
              HasSubstr("held out 1"));
  options = {};
  options.weight = 0.0;
  EXPECT_THAT(Message(options.Validate()), HasSubstr("weight 0"));
}

}  // namespace
}  // namespace shiftmap::testing

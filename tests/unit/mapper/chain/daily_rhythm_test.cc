// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/daily_rhythm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "mapper/chain/chain_expectations.h"
#include "tests/support/random_map.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;

constexpr double kDay = 86400.0;

ModeChain Door(double opens_per_day, double closes_per_day) {
  Eigen::MatrixXd rates(2, 2);
  rates << -opens_per_day, opens_per_day, closes_per_day, -closes_per_day;
  return *ModeChain::FromRates(rates / kDay);
}

std::vector<Stamp> Every(double seconds, double total) {
  std::vector<Stamp> stamps;
  for (double now = 0.0; now <= total; now += seconds) stamps.push_back(StampFromSeconds(now));
  return stamps;
}

// Open by day, closed by night: two halves of the day, each with its chain.
ChainPath SimulateHalfDays(const ModeChain& night,
                           const ModeChain& day,
                           int days,
                           std::mt19937_64& random) {
  ChainPath path;
  int state = 0;
  for (int half = 0; half < 2 * days; ++half) {
    const ChainPath part = SimulateChain(half % 2 == 0 ? night : day,
                                         state,
                                         StampFromSeconds(0.5 * kDay * half),
                                         StampFromSeconds(0.5 * kDay * (half + 1)),
                                         random);
    path.since.insert(path.since.end(), part.since.begin(), part.since.end());
    path.states.insert(path.states.end(), part.states.begin(), part.states.end());
    state = part.states.back();
  }
  return path;
}

TEST(DailyRhythmTest, IsTakenWhereThereIsOne) {
  std::mt19937_64 random(TestSeed(51));
  const ModeChain night = Door(0.5, 10.0);
  const ModeChain day = Door(30.0, 10.0);
  const ChainPath path = SimulateHalfDays(night, day, 60, random);
  const ChainHistory history = ObservePath(path, 2, Every(600.0, 60.0 * kDay), 0.01, random);
  DailyRhythmOptions options;
  options.phases = 4;
  const StatusOr<DailyRhythm> rhythm = LearnDailyRhythm(history, {}, options);
  ASSERT_TRUE(rhythm.ok());
  EXPECT_TRUE(rhythm->taken);
  EXPECT_GT(rhythm->held_out_gain, 10.0);
  ASSERT_EQ(rhythm->chains.size(), 4u);
  for (std::size_t phase = 0; phase < 4; ++phase) {
    const double opens = rhythm->chains[phase].rate_matrix()(0, 1) * kDay;
    EXPECT_NEAR(opens, phase < 2 ? 0.5 : 30.0, phase < 2 ? 1.0 : 8.0) << phase;
  }
  // Nearly as good as the rates it was drawn with, and those are hard to beat.
  const double truth = ChainLogLikelihood(MakeChainSteps(history, 4), {night, night, day, day});
  const double learned = ChainLogLikelihood(MakeChainSteps(history, 4), rhythm->chains);
  EXPECT_NEAR(learned, truth, 12.0);
}

TEST(DailyRhythmTest, IsNotTakenWhereThereIsNone) {
  std::mt19937_64 random(TestSeed(52));
  int taken = 0;
  for (int trial = 0; trial < 5; ++trial) {
    const std::vector<Stamp> stamps = Every(600.0, 40.0 * kDay);
    const ChainPath path = SimulateChain(Door(3.0, 6.0), 0, stamps.front(), stamps.back(), random);
    const StatusOr<DailyRhythm> rhythm =
        LearnDailyRhythm(ObservePath(path, 2, stamps, 0.01, random), {}, {});
    ASSERT_TRUE(rhythm.ok());
    taken += rhythm->taken ? 1 : 0;
    EXPECT_EQ(rhythm->chains.size(), rhythm->taken ? 24u : 1u);
  }
  EXPECT_LE(taken, 1);
}

TEST(DailyRhythmTest, WithoutVisitsInAPhaseItKeepsTheRatesOfTheDay) {
  ChainHistory history{Signature("7"), 2, {}};
  for (int day = 0; day < 30; ++day) {
    // From 10:00 to 10:30, and the night is one long gap that says little.
    for (const double second : {36000.0, 36600.0, 37200.0, 37800.0}) {
      const Stamp stamp = StampFromSeconds(kDay * day + second);
      history.visits.push_back({stamp, stamp, Eigen::VectorXd::Zero(2)});
    }
  }
  const ModeChain whole = Door(2.0, 3.0);
  for (const ModeChain& chain : FitDailyRates(history, whole, {})) {
    EXPECT_NEAR(chain.rate_matrix()(0, 1) * kDay, 2.0, 1e-3);
    EXPECT_NEAR(chain.rate_matrix()(1, 0) * kDay, 3.0, 1e-3);
  }
}

TEST(DailyRhythmTest, RefusesABadVisitAmongThoseHeldOut) {
  std::mt19937_64 random(TestSeed(43));
  std::vector<Stamp> stamps;
  for (int i = 0; i < 40; ++i) stamps.push_back(StampFromSeconds(7200.0 * i));
  const ModeChain chain = ModeChain::Uniform(1, 1e-4);
  ChainHistory history = ObservePath(
      SimulateChain(chain, 1, stamps.front(), stamps.back(), random), 2, stamps, 0.05, random);
  EXPECT_TRUE(LearnDailyRhythm(history, {}, {}).ok());
  history.visits[38].log_likelihoods.resize(0);
  EXPECT_EQ(LearnDailyRhythm(history, {}, {}).status().code(), StatusCode::kInvalidArgument);
}

TEST(DailyRhythmTest, RefusesTooFewVisits) {
  EXPECT_THAT(Message(LearnDailyRhythm({Signature("7"), 2, {}}, {}, {}).status()),
              HasSubstr("0 visits are too few"));
  DailyRhythmOptions options;
  options.phases = 1;
  EXPECT_THAT(Message(LearnDailyRhythm({Signature("7"), 2, {}}, {}, options).status()),
              HasSubstr("1 phases"));
}

}  // namespace
}  // namespace shiftmap::testing

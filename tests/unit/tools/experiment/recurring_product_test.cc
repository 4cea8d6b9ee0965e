// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/recurring_product.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "mapper/chain/chain_expectations.h"
#include "mapper/chain/learn_rhythm.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {
namespace {

constexpr double kDayS = 86400.0;

// A door that opens by day, seen every twenty minutes.
ChainHistory SeenDoor(int days) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  ChainHistory history{Signature("door"), 2, {}};
  int state = 0;
  for (double time = 0.0; time < days * kDayS; time += 1200.0) {
    const double of_day = std::fmod(time, kDayS);
    const bool by_day = of_day > 0.4 * kDayS && of_day < 0.7 * kDayS;
    const double opens = by_day ? 0.25 : 0.002;
    if (uniform(random) < (state == 0 ? opens : 0.2)) state = 1 - state;
    const Stamp stamp = StampFromSeconds(1.6e9 + time);
    history.visits.push_back(
        {stamp, stamp, state == 0 ? Eigen::Vector2d(0.0, -20.0) : Eigen::Vector2d(-20.0, 0.0)});
  }
  return history;
}

// The store, with its mistakes and its general options, is as good as the fit by itself.
TEST(ReplayRecord, PredictsAsTheFitDoesByItself) {
  const ChainHistory all = SeenDoor(28);
  const ChainHistory train = FirstVisits(all, all.visits.size() * 3 / 4);
  ChainHistory test = all;
  test.visits.erase(test.visits.begin(),
                    test.visits.begin() + static_cast<std::ptrdiff_t>(train.visits.size()) - 1);
  const auto replayed = ReplayRecord(train, test);
  ASSERT_TRUE(replayed.ok()) << Message(replayed.status());
  EXPECT_EQ(replayed->rhythm, kRhythmDay);
  EXPECT_TRUE(replayed->recomputed);

  const auto whole = LearnChain(train, {});
  ASSERT_TRUE(whole.ok());
  const auto learned = LearnRhythm(train, whole->fit, {}, {});
  ASSERT_TRUE(learned.ok());
  ASSERT_TRUE(learned->rhythm);
  std::vector<ModeChain> hours;
  for (const Eigen::MatrixXd& rates : learned->rhythm->rate_matrices()) {
    hours.push_back(*ModeChain::FromRates(rates));
  }
  const double length_h = ToSeconds(test.visits.back().end - test.visits.front().begin) / 3600.0;
  const double by_itself = PredictiveLogLikelihood(test, 1, hours) / length_h;
  const double without = PredictiveLogLikelihood(test, 1, {whole->chain}) / length_h;
  EXPECT_NEAR(replayed->nats_per_hour, by_itself, 0.02);
  EXPECT_GT(replayed->nats_per_hour, without + 0.02);
}

}  // namespace
}  // namespace shiftmap

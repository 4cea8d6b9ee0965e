// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/move_rate_estimate.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

std::vector<Stamp> Every(double gap_s, int visits) {
  std::vector<Stamp> times;
  for (int i = 0; i < visits; ++i) times.push_back(StampFromSeconds(1.7e9 + gap_s * i));
  return times;
}

TEST(MoveRate, WithoutVisitsTheIntervalIsThatOfThePrior) {
  const MoveRateEstimate estimate = EstimateMoveRate(1e-5, 3, {});
  EXPECT_NEAR(std::log(estimate.high_per_s / 1e-5), 1.959964 * std::sqrt(2.0), 1e-9);
  EXPECT_NEAR(estimate.low_per_s * estimate.high_per_s, 1e-10, 1e-20);
  EXPECT_EQ(EstimateMoveRate(0.0, 3, Every(60.0, 10)).high_per_s, 0.0);
}

// Gaps far longer than the chain's time constant tell nothing of its rate.
TEST(MoveRate, VisitsThatAreFarApartTellNothing) {
  const double prior = EstimateMoveRate(1e-2, 3, {}).high_per_s;
  EXPECT_NEAR(EstimateMoveRate(1e-2, 3, Every(1e6, 100)).high_per_s, prior, 1e-9);
}

// The maximum-likelihood estimates of simulated chains scatter as the interval says.
TEST(MoveRate, TheIntervalIsTheScatterOfEstimates) {
  constexpr double kRate = 1e-3;
  constexpr double kGapS = 300.0;
  constexpr int kVisits = 2000;
  std::mt19937_64 random(testing::TestSeed(5));
  std::uniform_real_distribution<double> uniform;
  // Of two states another is seen after a gap with p = (1 - exp(-2 λ Δ)) / 2.
  const double p = 0.5 * (1.0 - std::exp(-2.0 * kRate * kGapS));
  const std::vector<Stamp> times = Every(kGapS, kVisits);
  int covered = 0;
  constexpr int kTrials = 400;
  for (int trial = 0; trial < kTrials; ++trial) {
    int moved = 0;
    for (int i = 1; i < kVisits; ++i) moved += uniform(random) < p ? 1 : 0;
    const double share = static_cast<double>(moved) / (kVisits - 1);
    const double estimated = -std::log(1.0 - 2.0 * share) / (2.0 * kGapS);
    const MoveRateEstimate interval = EstimateMoveRate(estimated, 2, times);
    covered += interval.low_per_s < kRate && kRate < interval.high_per_s ? 1 : 0;
  }
  // 95 % of 400, and four standard deviations of that count.
  EXPECT_NEAR(covered, 380, 18);
}

}  // namespace
}  // namespace shiftmap

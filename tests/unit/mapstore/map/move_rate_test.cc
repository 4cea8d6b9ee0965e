// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/move_rate.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

TEST(MoveRate, OfAUniformChainIsItsLeaveRate) {
  EXPECT_EQ(MoveRate(ModeChain::Uniform(3, 1e-5)), 1e-5);
  EXPECT_EQ(MoveRate(ModeChain::Uniform(0, 0.0)), 0.0);
}

// A landmark that stays for weeks, and is back within the hour when it is away, moves seldom.
TEST(MoveRate, IsTheNumberOfMovesOfASimulatedChain) {
  Eigen::Matrix3d rates;
  rates << -3.0, 1.0, 2.0, 0.05, -0.06, 0.01, 0.5, 0.02, -0.52;
  const auto chain = ModeChain::FromRates(rates);
  ASSERT_THAT(chain, testing::IsOk());
  std::mt19937_64 random(testing::TestSeed(3));
  constexpr int kMoves = 200000;
  double seconds = 0.0;
  int state = 1;
  for (int move = 0; move < kMoves; ++move) {
    seconds += std::exponential_distribution<double>(-rates(state, state))(random);
    Eigen::Vector3d next = rates.row(state);
    next[state] = 0.0;
    state = std::discrete_distribution<int>(next.begin(), next.end())(random);
  }
  EXPECT_NEAR(MoveRate(*chain) * seconds / kMoves, 1.0, 0.03);
  EXPECT_GT(chain->leave_rate_per_s(), 4.0 * MoveRate(*chain));
}

}  // namespace
}  // namespace shiftmap

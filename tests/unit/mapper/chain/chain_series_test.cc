// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_series.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "mapper/chain/gap_integral.h"
#include "mapstore/map/rate_matrix.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

template <int kStates>
void ExpectExponentials(const Eigen::MatrixXd& rates, std::mt19937_64& random) {
  const Eigen::Index n = rates.rows();
  std::uniform_real_distribution<double> weight(0.0, 1.0);
  ChainSeries<kStates> series(rates);
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(n, n);
  double total = 0.0;
  for (const double share : {1e-9, 1e-3, 0.1, 0.5, 1.0}) {
    const double length = share / -rates.diagonal().minCoeff();
    ASSERT_TRUE(series.Suits(length));
    EXPECT_THAT(
        Eigen::MatrixXd(series.Flow(length)),
        IsNearMatrix(Eigen::MatrixXd(StochasticExponential(rates, length).transpose()), 1e-14));
    Eigen::MatrixXd weights(n, n);
    for (double& entry : weights.reshaped()) entry = weight(random);
    series.AddIntegral(length, weights);
    expected += GapIntegral(rates, length, weights);
    total += length;
    EXPECT_THAT(Eigen::MatrixXd(series.Sum() / total),
                IsNearMatrix(Eigen::MatrixXd(expected / total), 1e-13));
  }
  EXPECT_FALSE(series.Suits(1.01 / -rates.diagonal().minCoeff()));
}

TEST(ChainSeriesTest, AgreesWithExponentials) {
  std::mt19937_64 random(TestSeed(5));
  std::uniform_real_distribution<double> exponent(-8.0, -3.0);
  for (int trial = 0; trial < 40; ++trial) {
    const int states = 2 + trial % 5;
    Eigen::MatrixXd rates(states, states);
    for (double& rate : rates.reshaped()) rate = std::pow(10.0, exponent(random));
    rates.diagonal().setZero();
    rates.diagonal() = -rates.rowwise().sum();
    ExpectExponentials<Eigen::Dynamic>(rates, random);
    if (states == 3) ExpectExponentials<3>(rates, random);
  }
}

// Two eigenvectors of 0 to 1 to 2 at one rate are one.
TEST(ChainSeriesTest, NeedsNoEigenvectors) {
  std::mt19937_64 random(TestSeed(6));
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(3, 3);
  rates(0, 1) = rates(1, 2) = 1e-4;
  rates.diagonal() = -rates.rowwise().sum();
  ExpectExponentials<3>(rates, random);
}

// What takes several jumps is improbable in a short time, and not impossible.
TEST(ChainSeriesTest, ReachesEveryState) {
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(4, 4);
  rates(0, 1) = rates(1, 2) = rates(2, 3) = 1e-4;
  rates.diagonal() = -rates.rowwise().sum();
  const double all = ChainSeries<4>(rates).Flow(1.0)(3, 0);
  EXPECT_NEAR(all / (1e-12 / 6.0), 1.0, 1e-3);
}

TEST(ChainSeriesTest, OfAChainThatNeverMovesIsTime) {
  ChainSeries<2> series(Eigen::MatrixXd::Zero(2, 2));
  EXPECT_EQ(series.Flow(1e9), Eigen::Matrix2d::Identity());
  series.AddIntegral(1e9, Eigen::Matrix2d::Ones());
  EXPECT_THAT(Eigen::MatrixXd(series.Sum()),
              IsNearMatrix(Eigen::MatrixXd(Eigen::MatrixXd::Constant(2, 2, 1e9)), 1e-3));
}

}  // namespace
}  // namespace shiftmap::testing

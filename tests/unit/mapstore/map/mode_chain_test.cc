// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_chain.h"

#include <gtest/gtest.h>

#include <random>
#include <unsupported/Eigen/MatrixFunctions>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

TEST(ModeChainTest, TransitionIsTheMatrixExponential) {
  for (int modes = 1; modes <= 6; ++modes) {
    for (const double rate : {0.0, 1e-6, 1e-3, 2.0}) {
      const ModeChain chain = ModeChain::Uniform(modes, rate);
      for (const double seconds : {0.0, 0.1, 10.0, 1e5}) {
        const Eigen::MatrixXd expected = Eigen::MatrixXd(chain.rate_matrix() * seconds).exp();
        EXPECT_THAT(chain.Transition(FromSeconds(seconds)), IsNearMatrix(expected, 1e-10))
            << modes << " modes, rate " << rate << ", " << seconds << " s";
      }
    }
  }
}

TEST(ModeChainTest, RateMatrixLeavesEveryStateAlike) {
  const ModeChain chain = ModeChain::Uniform(3, 0.6);
  EXPECT_EQ(chain.states(), 4);
  EXPECT_THAT(chain.rate_matrix().rowwise().sum(), IsNearMatrix(Eigen::VectorXd::Zero(4), 1e-15));
  EXPECT_DOUBLE_EQ(chain.rate_matrix()(2, 2), -0.6);
  EXPECT_DOUBLE_EQ(chain.rate_matrix()(1, 3), 0.2);
}

TEST(ModeChainTest, WithoutModesNothingHappens) {
  const ModeChain chain = ModeChain::Uniform(0, 1.0);
  EXPECT_EQ(chain.states(), 1);
  EXPECT_EQ(chain.Transition(FromSeconds(9.0))(0, 0), 1.0);
  EXPECT_EQ(chain.Propagate(Eigen::VectorXd::Ones(1), FromSeconds(9.0))(0), 1.0);
}

TEST(ModeChainTest, PropagateMultipliesByTheTransposedTransition) {
  std::mt19937_64 random(TestSeed(21));
  const ModeChain chain = ModeChain::Uniform(4, 1e-2);
  const Eigen::VectorXd prior = RandomDistribution(random, 5);
  const Duration elapsed = FromSeconds(37.0);
  EXPECT_THAT(chain.Propagate(prior, elapsed),
              IsNearMatrix(Eigen::VectorXd(chain.Transition(elapsed).transpose() * prior), 1e-15));
}

TEST(ModeChainTest, IsNotRunBackwards) {
  const ModeChain chain = ModeChain::Uniform(2, 1.0);
  EXPECT_EQ(chain.Transition(FromSeconds(-5.0)), Eigen::MatrixXd::Identity(3, 3));
}

TEST(ModeChainDeathTest, NegativeRateIsTheCallersBug) {
  EXPECT_DEATH(ModeChain::Uniform(2, -1.0), "leave rate -1");
}

}  // namespace
}  // namespace shiftmap::testing

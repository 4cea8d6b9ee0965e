// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_chain.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <unsupported/Eigen/MatrixFunctions>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;

// Rates over three decades, one transition in five impossible; diagonal exact.
Eigen::MatrixXd RandomRates(std::mt19937_64& random, int states, double scale) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(states, states);
  for (int from = 0; from < states; ++from) {
    for (int to = 0; to < states; ++to) {
      if (from == to || uniform(random) < 0.2) continue;
      rates(from, to) = scale * std::pow(10.0, -3.0 * uniform(random));
    }
  }
  rates.diagonal() = -rates.rowwise().sum();
  return rates;
}

// exp(Q t) from its power series, at a step short enough for it, and repeated multiplication.
Eigen::MatrixXd SeriesExponential(const Eigen::MatrixXd& rates, double seconds) {
  using Matrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  constexpr int kSteps = 64;
  const Matrix exponent = rates.cast<long double>() * (seconds / kSteps);
  Matrix step = Matrix::Identity(rates.rows(), rates.rows());
  Matrix term = step;
  for (int k = 1; k < 60; ++k) {
    term = (term * exponent / k).eval();
    step += term;
  }
  Matrix power = Matrix::Identity(rates.rows(), rates.rows());
  for (int k = 0; k < kSteps; ++k) power = (power * step).eval();
  return power.cast<double>();
}

ModeChain Chain(const Eigen::MatrixXd& rates) {
  StatusOr<ModeChain> chain = ModeChain::FromRates(rates);
  EXPECT_TRUE(chain.ok()) << chain.status().ToString();
  return *std::move(chain);
}

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

TEST(ModeChainTest, GeneralTransitionIsThePowerSeries) {
  std::mt19937_64 random(TestSeed(22));
  for (int states = 2; states <= 10; ++states) {
    const Eigen::MatrixXd rates = RandomRates(random, states, 1e-2);
    const ModeChain chain = Chain(rates);
    for (const double seconds : {1e-6, 0.3, 40.0, 2e3}) {
      EXPECT_THAT(chain.Transition(FromSeconds(seconds)),
                  IsNearMatrix(SeriesExponential(rates, seconds), 1e-12))
          << states << " states, " << seconds << " s";
    }
  }
}

TEST(ModeChainTest, TimesAddUp) {
  std::mt19937_64 random(TestSeed(23));
  for (int trial = 0; trial < 20; ++trial) {
    const ModeChain chain = Chain(RandomRates(random, 2 + trial % 6, 1e-3));
    const Duration first = FromSeconds(std::pow(10.0, trial % 8 - 2));
    const Duration second = FromSeconds(77.0 * trial);
    EXPECT_THAT(
        chain.Transition(first + second),
        IsNearMatrix(Eigen::MatrixXd(chain.Transition(first) * chain.Transition(second)), 1e-12));
  }
}

TEST(ModeChainTest, RowsAreDistributionsAtAnyTime) {
  std::mt19937_64 random(TestSeed(24));
  for (const double scale : {1e-9, 1e-3, 1e3}) {
    const ModeChain chain = Chain(RandomRates(random, 5, scale));
    for (const double seconds : {0.0, 1e-9, 1e-3, 60.0, 3e7, 6e9}) {
      const Eigen::MatrixXd transition = chain.Transition(FromSeconds(seconds));
      EXPECT_GE(transition.minCoeff(), 0.0);
      EXPECT_THAT(transition.rowwise().sum(), IsNearMatrix(Eigen::VectorXd::Ones(5), 1e-14))
          << "rates of " << scale << ", " << seconds << " s";
    }
  }
}

TEST(ModeChainTest, ShortTimesKeepTheRates) {
  std::mt19937_64 random(TestSeed(25));
  const Eigen::MatrixXd rates = RandomRates(random, 4, 1e-6);
  const Eigen::MatrixXd transition = Chain(rates).Transition(FromSeconds(1e-3));
  for (int from = 0; from < 4; ++from) {
    for (int to = 0; to < 4; ++to) {
      if (from == to) continue;
      EXPECT_NEAR(transition(from, to), 1e-3 * rates(from, to), 1e-15) << from << " to " << to;
    }
  }
}

TEST(ModeChainTest, ForgetsInTheEnd) {
  Eigen::MatrixXd rates(3, 3);
  rates << -3.0, 1.0, 2.0, 4.0, -4.5, 0.5, 1.0, 1.0, -2.0;
  const ModeChain chain = Chain(rates);
  const Eigen::MatrixXd transition = chain.Transition(FromSeconds(6e9));
  const Eigen::RowVectorXd stationary = transition.row(0);
  EXPECT_THAT(stationary * rates, IsNearMatrix(Eigen::RowVectorXd::Zero(3), 1e-13));
  EXPECT_THAT(transition.row(2), IsNearMatrix(stationary, 1e-14));
  EXPECT_DOUBLE_EQ(chain.leave_rate_per_s(), 9.5 / 3.0);
}

TEST(ModeChainTest, EqualRatesAreTheUniformChain) {
  const ModeChain uniform = ModeChain::Uniform(4, 3e-4);
  const ModeChain chain = Chain(uniform.rate_matrix());
  EXPECT_TRUE(chain.uniform());
  EXPECT_DOUBLE_EQ(chain.leave_rate_per_s(), 3e-4);

  // A hair off, and the general algorithm is taken: its answer is the closed form's.
  Eigen::MatrixXd near = uniform.rate_matrix();
  near(0, 1) *= 1.0 + 1e-15;
  const ModeChain general = Chain(near);
  EXPECT_FALSE(general.uniform());
  for (const double seconds : {1e-3, 1.0, 1e3, 1e5, 1e9}) {
    EXPECT_THAT(general.Transition(FromSeconds(seconds)),
                IsNearMatrix(uniform.Transition(FromSeconds(seconds)), 1e-12));
  }
}

TEST(ModeChainTest, GeneralPropagateMultipliesByTheTransposedTransition) {
  std::mt19937_64 random(TestSeed(26));
  const ModeChain chain = Chain(RandomRates(random, 6, 1e-2));
  const Eigen::VectorXd prior = RandomDistribution(random, 6);
  const Duration elapsed = FromSeconds(37.0);
  EXPECT_THAT(chain.Propagate(prior, elapsed),
              IsNearMatrix(Eigen::VectorXd(chain.Transition(elapsed).transpose() * prior), 1e-15));
  EXPECT_EQ(chain.Transition(FromSeconds(-5.0)), Eigen::MatrixXd::Identity(6, 6));
}

TEST(ModeChainTest, RefusesWhatIsNoRateMatrix) {
  const auto message = [](const Eigen::MatrixXd& rates) {
    return Message(ModeChain::FromRates(rates).status());
  };
  EXPECT_THAT(message(Eigen::MatrixXd::Zero(2, 3)), HasSubstr("2 x 3, expected square"));
  Eigen::MatrixXd rates = ModeChain::Uniform(2, 0.5).rate_matrix();
  rates(1, 2) = -0.25;
  EXPECT_THAT(message(rates), HasSubstr("rate from 1 to 2: -0.25"));
  rates(1, 2) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(message(rates), HasSubstr("rate from 1 to 2: nan"));
  rates(1, 2) = 0.3;
  EXPECT_THAT(message(rates), HasSubstr("rates from 1 do not sum to 0"));
}

TEST(ModeChainDeathTest, NegativeRateIsTheCallersBug) {
  EXPECT_DEATH(ModeChain::Uniform(2, -1.0), "leave rate -1");
}

}  // namespace
}  // namespace shiftmap::testing

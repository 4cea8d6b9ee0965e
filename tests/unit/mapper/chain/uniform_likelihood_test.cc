// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/uniform_likelihood.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "mapper/chain/chain_expectations.h"
#include "tests/support/random_map.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap::testing {
namespace {

// The oracle are differences of the likelihood of a chain given by its rates.
TEST(UniformLikelihoodTest, DerivativesAreThoseOfTheLikelihood) {
  std::mt19937_64 random(TestSeed(35));
  std::exponential_distribution<double> gap(1.0 / 20'000.0);
  for (const int modes : {1, 2, 3, 6}) {
    std::vector<Stamp> stamps;
    double now = 0.0;
    for (int i = 0; i < 60; ++i) stamps.push_back(StampFromSeconds(now += gap(random)));
    const ModeChain truth = ModeChain::Uniform(modes, 1e-5);
    const ChainPath path = SimulateChain(truth, 0, stamps.front(), stamps.back(), random);
    const ChainSteps steps = MakeChainSteps(ObservePath(path, modes + 1, stamps, 0.05, random));
    const auto value = [&](double log_rate) {
      return ExpectChain(steps, {ModeChain::Uniform(modes, std::exp(log_rate)).rate_matrix()})
          .log_likelihood;
    };
    for (const double log_rate : {-16.0, -11.5, -8.0}) {
      const UniformLikelihood found = EvaluateUniform(steps, log_rate);
      constexpr double kStep = 1e-3;
      const double above = value(log_rate + kStep);
      const double below = value(log_rate - kStep);
      EXPECT_NEAR(found.value, value(log_rate), 1e-9);
      EXPECT_NEAR(found.slope, (above - below) / (2.0 * kStep), 1e-4);
      EXPECT_NEAR(found.curvature, (above - 2.0 * found.value + below) / (kStep * kStep), 1e-3)
          << modes << " modes, " << log_rate;
    }
  }
}

// Evidence of a thousand visits underflows, and their likelihood does not.
TEST(UniformLikelihoodTest, OfManyVisitsIsFinite) {
  ChainHistory history{Signature("7"), 2, {}};
  for (int i = 0; i < 3000; ++i) {
    const Stamp stamp = StampFromSeconds(i);
    history.visits.push_back({stamp, stamp, Eigen::Vector2d(i % 2 == 0 ? 0.0 : -50.0, -30.0)});
  }
  const ChainSteps steps = MakeChainSteps(history);
  const double expected =
      ExpectChain(steps, {ModeChain::Uniform(1, 1e-4).rate_matrix()}).log_likelihood;
  EXPECT_LT(expected, -1e4);
  EXPECT_NEAR(EvaluateUniform(steps, std::log(1e-4)).value, expected, 1e-6);
}

}  // namespace
}  // namespace shiftmap::testing

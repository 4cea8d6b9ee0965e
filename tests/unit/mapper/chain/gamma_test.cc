// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/gamma.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

TEST(GammaTest, QuantilesOfTheExponentialDistribution) {
  const Gamma gamma{1.0, 20.0};
  for (const double probability : {1e-6, 0.05, 0.5, 0.95, 1.0 - 1e-9}) {
    const double expected = -std::log1p(-probability) / 20.0;
    EXPECT_NEAR(gamma.Quantile(probability), expected, 1e-6 * expected);
  }
}

TEST(GammaTest, QuantilesOfTheChiSquareDistribution) {
  // Tables: 0.95 quantiles with 1, 2, 10 and 100 degrees of freedom.
  const double expected[][2] = {{1, 3.841459}, {2, 5.991465}, {10, 18.307038}, {100, 124.342113}};
  for (const auto& [freedom, value] : expected) {
    EXPECT_NEAR((Gamma{0.5 * freedom, 0.5}.Quantile(0.95)), value, 1e-5);
  }
  // (2^shape Γ(shape + 1) P)^(1/shape) for small x: 1 degree of freedom, P = 1e-8.
  EXPECT_NEAR((Gamma{0.5, 0.5}.Quantile(1e-8)), 1.5707963e-16, 1e-20);
}

// Where next to nothing is known, P = (exposure x)^shape / Γ(shape + 1) far down.
TEST(GammaTest, QuantilesOfSmallShapes) {
  const double shape = 0.05;
  EXPECT_NEAR(std::log(Gamma{shape, 1.0}.Quantile(0.025)),
              (std::log(0.025) + std::lgamma(shape + 1.0)) / shape,
              1e-8);
  EXPECT_EQ((Gamma{1e-7, 1.0}.Quantile(0.025)), 0.0);
}

TEST(GammaTest, DensityOfTheLogarithmIntegratesToOne) {
  const Gamma gamma{0.7, 300.0};
  double sum = 0.0;
  double mean_log = 0.0;
  constexpr double kStep = 1e-3;
  for (double log_rate = -60.0; log_rate < 5.0; log_rate += kStep) {
    const double mass = kStep * std::exp(gamma.LogDensityOfLog(log_rate));
    sum += mass;
    mean_log += mass * log_rate;
  }
  EXPECT_NEAR(sum, 1.0, 1e-9);
  EXPECT_NEAR(gamma.MeanLog(), mean_log, 1e-6);
}

TEST(GammaTest, AMixtureHasTheMeanAndTheVarianceOfItsParts) {
  const Gamma first{2.0, 4.0};
  const Gamma second{9.0, 3.0};
  for (const double share : {0.0, 0.25, 1.0}) {
    const Gamma mixture = MixtureOf(first, second, share);
    const double mean = (1.0 - share) * 0.5 + share * 3.0;
    const double squares = (1.0 - share) * (0.125 + 0.25) + share * (1.0 + 9.0);
    EXPECT_NEAR(mixture.mean(), mean, 1e-12) << share;
    EXPECT_NEAR(mixture.mean() / mixture.exposure_s, squares - mean * mean, 1e-12) << share;
  }
}

TEST(GammaTest, IsFoundAgainFromItsMeans) {
  for (const double shape : {0.02, 0.5, 3.0, 4e4}) {
    const Gamma gamma{shape, 1e5};
    const Gamma found = GammaFromMeans(gamma.mean(), gamma.MeanLog());
    EXPECT_NEAR(found.shape, shape, 1e-5 * shape);
    EXPECT_NEAR(found.mean(), gamma.mean(), 1e-9 * gamma.mean());
  }
  // No spread at all.
  EXPECT_NEAR(GammaFromMeans(2.0, std::log(2.0)).shape, 1e6, 1.0);
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/position_region.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <random>
#include <vector>

#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

TEST(PositionRegionTest, CircleAboutTheMeanHasTheRayleighForm) {
  for (const double sd : {1e-4, 0.05, 30.0}) {
    const std::vector<WeightedPosition> one = {
        {2.0, Vector2d(4.0, -3.0), Matrix2d::Identity() * sd * sd}};
    for (const double k : {0.1, 1.0, 2.4477, 5.0}) {
      EXPECT_NEAR(ProbabilityWithin(one, one[0].p, k * sd), 1.0 - std::exp(-0.5 * k * k), 1e-6);
    }
    EXPECT_NEAR(RadiusHolding(0.95, one, one[0].p),
                sd * std::sqrt(-2.0 * std::log(0.05)),
                1e-4 + 2e-3 * sd);
  }
}

// An ellipse so thin that only its long axis counts.
TEST(PositionRegionTest, LineHasTheNormalForm) {
  Matrix2d cov;
  cov << 0.5, 0.5, 0.5, 0.5 + 1e-12;
  const std::vector<WeightedPosition> one = {{1.0, Vector2d::Zero(), cov}};
  EXPECT_NEAR(RadiusHolding(0.95, one, Vector2d::Zero()), 1.95996, 4e-3);
}

TEST(PositionRegionTest, MixtureAgreesWithSamples) {
  constexpr int kCases = 20;
  constexpr int kSamples = 40000;
  std::mt19937_64 random(testing::TestSeed(5));
  std::normal_distribution<double> normal;
  for (int i = 0; i < kCases; ++i) {
    std::vector<WeightedPosition> mixture;
    std::vector<double> weights;
    for (const Vector2d& p : testing::RandomPositions(random, 1 + i % 4, 1.0)) {
      const double scale = std::pow(10.0, -2.0 * (i % 3));
      mixture.push_back(
          {0.1 + std::abs(normal(random)), p, testing::RandomCovariance(random, scale)});
      weights.push_back(mixture.back().weight);
    }
    const Vector2d center = mixture.front().p + 0.1 * Vector2d(normal(random), normal(random));
    const double radius = RadiusHolding(0.95, mixture, center);
    std::discrete_distribution<std::size_t> choose(weights.begin(), weights.end());
    int inside = 0;
    for (int k = 0; k < kSamples; ++k) {
      const WeightedPosition& position = mixture[choose(random)];
      const Matrix2d L = position.cov.llt().matrixL();
      inside +=
          (position.p + L * Vector2d(normal(random), normal(random)) - center).norm() <= radius;
    }
    // Five standard deviations of the count.
    EXPECT_NEAR(inside, 0.95 * kSamples, 5.0 * std::sqrt(0.95 * 0.05 * kSamples)) << i;
  }
}

TEST(PositionRegionTest, HypothesisFarAwayIsInTheRangeOnlyIfItsWeightMatters) {
  const Matrix2d cov = Matrix2d::Identity() * 0.01;
  const std::vector<WeightedPosition> light = {{0.99, Vector2d::Zero(), cov},
                                               {0.01, Vector2d(9.0, 0.0), cov}};
  const std::vector<WeightedPosition> heavy = {{0.8, Vector2d::Zero(), cov},
                                               {0.2, Vector2d(9.0, 0.0), cov}};
  EXPECT_LT(RadiusHolding(0.95, light, Vector2d::Zero()), 0.3);
  EXPECT_NEAR(RadiusHolding(0.95, heavy, Vector2d::Zero()), 9.07, 0.02);
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/vehicle_records.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <random>

#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

TEST(VehicleRecordsTest, OfNothingTheUsualProbabilityIsKnown) {
  EXPECT_DOUBLE_EQ(VehicleRecords().MistakeProbability(7), kMistakeProbability);
}

// The oracle: the recursion over both conditions of the vehicle.
TEST(VehicleRecordsTest, IsThePosteriorOfTheVehiclesCondition) {
  std::mt19937_64 random(TestSeed(33));
  std::normal_distribution<double> factor(0.0, 3.0);
  constexpr double kWorking = 0.5 * kMistakeProbability;
  constexpr double kBroken = 0.9;
  constexpr double kPrior = (kMistakeProbability - kWorking) / (kBroken - kWorking);
  Eigen::Vector2d p(1.0 - kPrior, kPrior);
  VehicleRecords records;
  for (int i = 0; i < 30; ++i) {
    const double log_factor = factor(random);
    records.Add({7, 0.0, std::exp(log_factor)});
    p = 0.99 * p + 0.01 * Eigen::Vector2d(1.0 - kPrior, kPrior);
    p[0] *= 1.0 - kWorking + kWorking * std::exp(log_factor);
    p[1] *= 1.0 - kBroken + kBroken * std::exp(log_factor);
    p /= p.sum();
    ASSERT_NEAR(records.MistakeProbability(7), p.dot(Eigen::Vector2d(kWorking, kBroken)), 1e-12);
  }
  EXPECT_EQ(records.MistakeProbability(8), kMistakeProbability);
}

TEST(VehicleRecordsTest, ARepairedVehicleIsTrustedAgain) {
  VehicleRecords records;
  const double contradicted = 100.0;
  const double confirmed = 0.5;
  for (int i = 0; i < 5; ++i) records.Add({7, 0.0, contradicted});
  EXPECT_GT(records.MistakeProbability(7), 0.8);
  for (int i = 0; i < 1000; ++i) records.Add({7, 0.0, 1e300});
  for (int i = 0; i < 20; ++i) records.Add({7, 0.0, confirmed});
  EXPECT_LT(records.MistakeProbability(7), 0.01);
}

TEST(VehicleRecordsTest, OneContradictionIsNoPattern) {
  VehicleRecords records;
  for (int i = 0; i < 50; ++i) records.Add({7, 0.0, i == 40 ? 100.0 : 0.5});
  EXPECT_LT(records.MistakeProbability(7), 5.0 * kMistakeProbability);
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/own_field_of_view.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "mapstore/core/quantile.h"
#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kStep = 2.0 * kPi / 256.0;  // Of bearings.

SensorCalibration Sensor() {
  SensorCalibration sensor;
  sensor.max_range_m = 10.0;
  sensor.max_bearing_rad = 1.5;
  return sensor;
}

Eigen::Vector2d At(double range_m, double bearing_rad) {
  return range_m * Eigen::Vector2d(std::cos(bearing_rad), std::sin(bearing_rad));
}

TEST(OwnFieldOfView, IsNothingBeforeTheFirstSighting) {
  const OwnFieldOfView own(Sensor());
  EXPECT_EQ(own.MakeSector().max_range_m, 0.0);
  EXPECT_FALSE(own.MakeSector().Contains({0.1, 0.0}));
}

TEST(OwnFieldOfView, ReachesAsFarAsTheFirstSightings) {
  OwnFieldOfView own(Sensor());
  own.Add(At(4.1, -0.5));
  own.Add(At(2.0, 0.7));
  EXPECT_NEAR(own.MakeSector().max_range_m, 4.2, 1e-12);
  EXPECT_NEAR(own.MakeSector().centre_rad, 0.1, kStep);
  EXPECT_NEAR(own.MakeSector().half_width_rad, 0.6 + kStep, 0.51 * kStep);
}

// The oracle sorts all that was seen.
TEST(OwnFieldOfView, HoldsNearlyAllRangesThatWereSeen) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> noise(0.0, 0.1);
  for (const double reach_m : {2.5, 4.0, 7.7, 10.0, 13.0}) {
    std::uniform_real_distribution<double> range(0.0, reach_m);
    OwnFieldOfView own(Sensor());
    std::vector<double> ranges;
    for (int i = 0; i < 2000; ++i) {
      ranges.push_back(std::abs(range(random) + noise(random)));
      own.Add(At(ranges.back(), 0.3));
    }
    const double quantile = Quantile(ranges, 0.99);
    EXPECT_GE(own.MakeSector().max_range_m, std::min(quantile, 10.0) - 1e-9);
    EXPECT_LE(own.MakeSector().max_range_m, std::min(quantile + 0.25, 10.0) + 1e-12);
  }
}

// Ahead, to a side, to the rear, and nearly all round.
TEST(OwnFieldOfView, HoldsTheArcInWhichLandmarksWereSeen) {
  std::mt19937_64 random(6);
  for (const auto& [centre, half_width] : {std::pair(0.0, 1.0),
                                           std::pair(-0.5, 0.7),
                                           std::pair(1.6, 0.6),
                                           std::pair(kPi, 0.4),
                                           std::pair(-2.9, 1.1),
                                           std::pair(0.4, 3.0)}) {
    std::uniform_real_distribution<double> bearing(centre - half_width, centre + half_width);
    OwnFieldOfView own(Sensor());
    for (int i = 0; i < 5000; ++i) own.Add(At(3.0, bearing(random)));
    const double share_missing = 0.01 * half_width;
    EXPECT_NEAR(own.MakeSector().half_width_rad, half_width - share_missing, 1.5 * kStep) << centre;
    EXPECT_NEAR(WrapAngle(own.MakeSector().centre_rad - centre), 0.0, share_missing + kStep)
        << centre;
    EXPECT_TRUE(own.MakeSector().Contains(At(3.0, centre)));
    EXPECT_FALSE(own.MakeSector().Contains(At(3.0, centre + kPi))) << centre;
  }
}

TEST(OwnFieldOfView, OfASensorAllRoundIsNearlyTheCircle) {
  OwnFieldOfView own(Sensor());
  for (int k = 0; k < 256; ++k) own.Add(At(3.0, (k + 0.5) * kStep));
  // Two bins are one in a hundred.
  EXPECT_NEAR(own.MakeSector().half_width_rad, kPi - 0.5 * kStep, 1e-9);
}

TEST(OwnFieldOfView, ReachesNoFartherThanTheSensor) {
  OwnFieldOfView own(Sensor());
  for (int i = 0; i < 10; ++i) own.Add(At(1e6, 3.0));
  EXPECT_EQ(own.MakeSector().max_range_m, 10.0);
}

}  // namespace
}  // namespace shiftmap

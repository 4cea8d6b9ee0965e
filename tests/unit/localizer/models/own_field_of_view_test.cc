// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/own_field_of_view.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "mapstore/core/quantile.h"

namespace shiftmap {
namespace {

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
  EXPECT_EQ(own.sensor().max_range_m, 0.0);
  EXPECT_EQ(own.sensor().max_bearing_rad, 0.0);
  EXPECT_FALSE(own.IsWhole());
  EXPECT_EQ(own.sensor().detection_probability, Sensor().detection_probability);
}

TEST(OwnFieldOfView, ReachesAsFarAsTheFirstSightings) {
  OwnFieldOfView own(Sensor());
  own.Add(At(4.1, -0.5));
  own.Add(At(2.0, 0.7));
  EXPECT_NEAR(own.sensor().max_range_m, 4.2, 1e-12);
  EXPECT_NEAR(own.sensor().max_bearing_rad, 0.72, 1e-12);
}

// The oracle sorts all that was seen.
TEST(OwnFieldOfView, HoldsNearlyAllThatWasSeen) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> noise(0.0, 0.1);
  for (const double reach_m : {2.5, 4.0, 7.7, 10.0, 13.0}) {
    std::uniform_real_distribution<double> range(0.0, reach_m);
    std::uniform_real_distribution<double> bearing(-0.12 * reach_m, 0.12 * reach_m);
    OwnFieldOfView own(Sensor());
    std::vector<double> ranges;
    std::vector<double> bearings;
    for (int i = 0; i < 2000; ++i) {
      ranges.push_back(std::abs(range(random) + noise(random)));
      bearings.push_back(bearing(random));
      own.Add(At(ranges.back(), bearings.back()));
      bearings.back() = std::abs(bearings.back());
    }
    const auto expect_bin_above = [](double limit, double quantile, double most) {
      EXPECT_GE(limit, std::min(quantile, most) - 1e-9);
      EXPECT_LE(limit, std::min(quantile + most / 40.0, most) + 1e-12);
    };
    expect_bin_above(own.sensor().max_range_m, Quantile(ranges, 0.99), 10.0);
    expect_bin_above(own.sensor().max_bearing_rad, Quantile(bearings, 0.99), 1.5);
    EXPECT_EQ(own.IsWhole(), reach_m > 10.0) << reach_m;
  }
}

TEST(OwnFieldOfView, IsTheSensorsIfNothingIsLearned) {
  OwnFieldOfView own = OwnFieldOfView::Whole(Sensor());
  EXPECT_TRUE(own.IsWhole());
  for (int i = 0; i < 1000; ++i) own.Add(At(1.0, 0.1));
  EXPECT_TRUE(own.IsWhole());
  EXPECT_EQ(own.sensor().max_range_m, Sensor().max_range_m);
  EXPECT_EQ(own.sensor().max_bearing_rad, Sensor().max_bearing_rad);
}

TEST(OwnFieldOfView, IsNeverMoreThanTheSensor) {
  OwnFieldOfView own(Sensor());
  for (int i = 0; i < 10; ++i) own.Add(At(1e6, 3.0));
  EXPECT_EQ(own.sensor().max_range_m, Sensor().max_range_m);
  EXPECT_EQ(own.sensor().max_bearing_rad, Sensor().max_bearing_rad);
  EXPECT_TRUE(own.IsWhole());
}

}  // namespace
}  // namespace shiftmap

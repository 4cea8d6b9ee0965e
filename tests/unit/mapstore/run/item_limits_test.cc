// SPDX-License-Identifier: Apache-2.0
#include "mapstore/run/item_limits.h"

#include <gtest/gtest.h>

#include <limits>

namespace shiftmap {
namespace {

Observation Seen(Observation::Kind kind, double first, double second) {
  Observation observation;
  observation.kind = kind;
  observation.z = {first, second};
  return observation;
}

TEST(ItemLimits, ReachAtLeastTenTimesAsFarAsTheSensorSees) {
  SensorCalibration sensor;
  EXPECT_EQ(ItemLimits::For(sensor).max_range_m, 1000.0);
  sensor.max_range_m = 300.0;
  EXPECT_EQ(ItemLimits::For(sensor).max_range_m, 3000.0);
}

TEST(ItemLimits, AreBoundsOfBothSigns) {
  const ItemLimits limits;
  EXPECT_TRUE(IsPlausible(OdometrySample{{}, -100.0, 50.0}, limits));
  EXPECT_FALSE(IsPlausible(OdometrySample{{}, -100.1, 0.0}, limits));
  EXPECT_FALSE(IsPlausible(OdometrySample{{}, 0.0, 50.1}, limits));
  EXPECT_FALSE(
      IsPlausible(OdometrySample{{}, std::numeric_limits<double>::quiet_NaN(), 0.0}, limits));
}

TEST(ItemLimits, AreOfTheRangeWhateverTheMeasurementIs) {
  const ItemLimits limits;
  EXPECT_TRUE(IsPlausible(Seen(Observation::Kind::kRangeBearing, 1000.0, 1e9), limits));
  EXPECT_FALSE(IsPlausible(Seen(Observation::Kind::kRangeBearing, 1e9, 0.0), limits));
  EXPECT_TRUE(IsPlausible(Seen(Observation::Kind::kCartesian, -600.0, 800.0), limits));
  EXPECT_FALSE(IsPlausible(Seen(Observation::Kind::kCartesian, -600.0, 801.0), limits));
}

TEST(ItemLimits, AreOfTheStatedCovarianceToo) {
  const auto plausible = [](Observation::Kind kind, double sd_first, double sd_second) {
    Observation observation = Seen(kind, 5.0, 0.1);
    observation.cov_z = Eigen::Vector2d(sd_first, sd_second).cwiseAbs2().asDiagonal();
    return IsPlausible(observation, ItemLimits());
  };
  constexpr auto kPolar = Observation::Kind::kRangeBearing;
  constexpr auto kCartesian = Observation::Kind::kCartesian;
  EXPECT_TRUE(plausible(kPolar, 1e-5, 1e-5));
  EXPECT_TRUE(plausible(kPolar, 900.0, 3.0));
  EXPECT_FALSE(plausible(kPolar, 1001.0, 0.1));
  EXPECT_FALSE(plausible(kPolar, 0.1, 3.2));
  EXPECT_FALSE(plausible(kPolar, 1e-150, 0.1));
  EXPECT_FALSE(plausible(kPolar, 0.1, 1e-9));
  EXPECT_TRUE(plausible(kCartesian, 900.0, 900.0));
  EXPECT_FALSE(plausible(kCartesian, 0.1, 1001.0));
  EXPECT_FALSE(plausible(kCartesian, 1e-9, 0.1));
}

TEST(DropImplausible, CountsWhatItDropsAndKeepsEmptyScans) {
  shiftmap::Run run;
  run.odometry = {{StampFromSeconds(1.0), 1.0, 0.0}, {StampFromSeconds(2.0), 1e8, 0.0}};
  Scan scan;
  scan.observations = {Seen(Observation::Kind::kRangeBearing, 1e9, 0.0)};
  run.scans = {scan};
  const ImplausibleItems dropped = DropImplausible(ItemLimits(), &run);
  EXPECT_TRUE(dropped.any());
  EXPECT_EQ(dropped.odometry, 1);
  EXPECT_EQ(dropped.observations, 1);
  EXPECT_EQ(run.odometry.size(), 1u);
  ASSERT_EQ(run.scans.size(), 1u);
  EXPECT_TRUE(run.scans.front().observations.empty());
}

}  // namespace
}  // namespace shiftmap

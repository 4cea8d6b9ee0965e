// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/vehicle_calibration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/run_spread.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

MapContent TwoVehicles() {
  std::mt19937_64 random(TestSeed(91));
  return RandomContent(random, {.groups = 3, .vehicles = 2});
}

TEST(IntervalTest, ClosedForms) {
  const Interval normal = IntervalOf(Estimate{2.0, 0.5});
  EXPECT_NEAR(normal.low, 2.0 - 0.98, 1e-4);
  EXPECT_NEAR(normal.high, 2.0 + 0.98, 1e-4);
  // Chi-square with 2 degrees of freedom is exponential: its quantiles are -2 log(1 - p).
  const Interval noise = IntervalOf(NoiseEstimate{0.3, 2.0});
  EXPECT_NEAR(noise.low, 0.3 * std::sqrt(-1.0 / std::log(0.025)), 1e-9);
  EXPECT_NEAR(noise.high, 0.3 * std::sqrt(-1.0 / std::log(0.975)), 1e-9);
  EXPECT_EQ(IntervalOf(NoiseEstimate{}).high, std::numeric_limits<double>::infinity());
  // Wilson's bounds p solve (share - p)² = z² p (1 - p) / n.
  const Interval share = IntervalOf(ShareEstimate{0.9, 40.0});
  for (const double p : {share.low, share.high}) {
    EXPECT_NEAR((0.9 - p) * (0.9 - p), 1.959964 * 1.959964 * p * (1.0 - p) / 40.0, 1e-9);
  }
  EXPECT_EQ(IntervalOf(ShareEstimate{}).high, 1.0);
}

TEST(VehicleCalibrationTest, ValuesHaveNamesOfTheirOwn) {
  const std::set<std::string> names(kVehicleValueNames.begin(), kVehicleValueNames.end());
  EXPECT_EQ(names.size(), kVehicleValues);
  VehicleCalibration vehicle;
  const auto values = VehicleValues(&vehicle);
  EXPECT_EQ(std::set<double*>(values.begin(), values.end()).size(), kVehicleValues);
}

TEST(VehicleCalibrationTest, OwnValuesReplaceTheFleets) {
  const MapContent content = TwoVehicles();
  const VehicleCalibration& vehicle = content.vehicles[1];
  const Calibration own = CalibrationOf(vehicle, content.calibration);
  EXPECT_EQ(own.odometry.scale_v, std::exp(vehicle.log_scale_v.value));
  EXPECT_EQ(own.odometry.lag_s, vehicle.lag_s.value);
  const double sd_log_scale = std::max(vehicle.log_scale_v.sd, vehicle.log_scale_omega.sd);
  EXPECT_NEAR(own.odometry.sd_log_scale, std::hypot(sd_log_scale, kRunSpread.log_scale), 1e-15);
  EXPECT_EQ(own.odometry.noise_omega, vehicle.noise_omega.sd);
  EXPECT_EQ(own.sensor.bearing_offset_rad, vehicle.bearing_offset_rad.value);
  EXPECT_NEAR(
      own.sensor.sd_bearing_rad,
      std::hypot(
          vehicle.bearing_rad.sd, vehicle.bearing_offset_rad.sd, kRunSpread.bearing_offset_rad),
      1e-15);
  EXPECT_EQ(own.sensor.detection_probability, vehicle.detection.share);
  EXPECT_EQ(own.sensor.max_range_m, content.calibration.sensor.max_range_m);
}

TEST(VehicleCalibrationTest, WhatIsNotKnownStaysTheFleets) {
  const MapContent content = TwoVehicles();
  VehicleCalibration vehicle = content.vehicles[0];
  vehicle.bearing_rad = {};
  vehicle.range_m = {};
  vehicle.detection = {};
  const Calibration own = CalibrationOf(vehicle, content.calibration);
  EXPECT_EQ(own.sensor.sd_range_m, content.calibration.sensor.sd_range_m);
  EXPECT_EQ(own.sensor.sd_bearing_rad, content.calibration.sensor.sd_bearing_rad);
  EXPECT_EQ(own.sensor.bearing_offset_rad, 0.0);
  EXPECT_EQ(own.sensor.detection_probability, content.calibration.sensor.detection_probability);
}

TEST(VehicleCalibrationTest, ASnapshotKnowsTheVehicleByName) {
  const MapContent content = TwoVehicles();
  const MapSnapshot map("a", VersionNumber(1), ContentHash(content), content);
  EXPECT_EQ(map.calibrated_vehicle(), "");
  EXPECT_EQ(map.calibration().odometry.lag_s, content.calibration.odometry.lag_s);
  const MapSnapshot own = map.ForVehicle("truck-1");
  EXPECT_EQ(own.calibrated_vehicle(), "truck-1");
  EXPECT_EQ(own.calibration().odometry.lag_s, content.vehicles[1].lag_s.value);
  EXPECT_EQ(own.content_hash(), map.content_hash());
  EXPECT_EQ(&own.content(), &map.content());
  const MapSnapshot other = own.ForVehicle("truck-7");
  EXPECT_EQ(other.calibrated_vehicle(), "");
  EXPECT_EQ(other.calibration().odometry.lag_s, content.calibration.odometry.lag_s);
}

TEST(VehicleCalibrationTest, InvalidContentIsNamed) {
  const MapContent good = TwoVehicles();
  EXPECT_THAT(ValidateMapContent(good), IsOk());
  MapContent bad = good;
  std::swap(bad.vehicles[0], bad.vehicles[1]);
  EXPECT_THAT(ValidateMapContent(bad),
              StatusIs(StatusCode::kInvalidArgument, "vehicle 'truck-0': names do not ascend"));
  bad = good;
  bad.vehicles[0].vehicle.clear();
  EXPECT_THAT(ValidateMapContent(bad), StatusIs(StatusCode::kInvalidArgument, "empty name"));
  bad = good;
  bad.calibration.sensor.bearing_offset_rad = 0.1;
  EXPECT_THAT(ValidateMapContent(bad), StatusIs(StatusCode::kInvalidArgument, "bearing offset"));
  for (std::size_t i = 0; i < kVehicleValues; ++i) {
    bad = good;
    *VehicleValues(&bad.vehicles[1])[i] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THAT(ValidateMapContent(bad),
                StatusIs(StatusCode::kInvalidArgument, "vehicle 'truck-1': calibration"))
        << kVehicleValueNames[i];
  }
}

}  // namespace
}  // namespace shiftmap::testing

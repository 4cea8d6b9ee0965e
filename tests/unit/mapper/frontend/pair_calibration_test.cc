// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/pair_calibration.h"

#include <gtest/gtest.h>

#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

TEST(CalibrateFromPairs, RecoversScalesAndLag) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    OpenWorldOptions options = testing::SmallWorld(seed);
    options.runs = 1;
    options.duration_s = 200.0;
    options.scan_rate_hz = 5.0;
    options.odometry.scale_v = 1.06;
    options.odometry.scale_omega = 0.95;
    options.odometry.lag_s = 0.2;
    options.sensor.sd_range_m = 0.05;
    options.sensor.sd_bearing_rad = 0.01;
    const SimulatedWorld world = testing::Simulate(options);
    const Calibration all =
        CalibrateFromPairs(testing::Arrange(world, world.runs[0].run), {{}, options.sensor});
    const OdometryCalibration& found = all.odometry;
    EXPECT_NEAR(found.scale_v, 1.06, 0.015) << seed;
    EXPECT_NEAR(found.scale_omega, 0.95, 0.015) << seed;
    EXPECT_NEAR(found.lag_s, 0.2, 0.05) << seed;
    EXPECT_EQ(found.noise_v, OdometryCalibration().noise_v);
    EXPECT_NEAR(all.sensor.sd_range_m, options.sensor.sd_range_m, 0.01) << seed;
    EXPECT_NEAR(all.sensor.sd_bearing_rad, options.sensor.sd_bearing_rad, 0.003) << seed;
  }
}

TEST(CalibrateFromPairs, ALandmarkThatMovedDoesNoHarm) {
  OpenWorldOptions options = testing::SmallWorld(3);
  options.runs = 1;
  options.odometry.scale_v = 1.05;
  SimulatedWorld world = testing::Simulate(options);
  // Half of all observations are read as one landmark's: it stands somewhere else at every visit.
  std::vector<Scan>& scans = world.runs[0].run.scans;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    if (i / 40 % 2 == 0) continue;
    for (Observation& observation : scans[i].observations) {
      observation.signature = world.groups[0].signature;
    }
  }
  const OdometryCalibration found =
      CalibrateFromPairs(testing::Arrange(world, world.runs[0].run), {{}, options.sensor}).odometry;
  EXPECT_NEAR(found.scale_v, 1.05, 0.03);
  EXPECT_NEAR(found.scale_omega, 1.0, 0.03);
}

// Most sightings are made at standstill, by a sensor that reads the same again and again.
TEST(CalibrateFromPairs, ReadingsThatRepeatAreNotTakenForExact) {
  OpenWorldOptions options = testing::SmallWorld(4);
  options.runs = 1;
  const SimulatedWorld world = testing::Simulate(options);
  shiftmap::Run run = world.runs[0].run;
  const Duration standing =
      FromSeconds(3.0 * ToSeconds(run.odometry.back().stamp - run.odometry.front().stamp));
  const Stamp stop = run.scans.back().stamp;
  const Scan last = run.scans.back();
  ASSERT_FALSE(last.observations.empty());
  run.odometry.back().v_mps = 0.0;
  run.odometry.back().omega_radps = 0.0;
  while (run.odometry.back().stamp < stop + standing) {
    run.odometry.push_back({run.odometry.back().stamp + FromSeconds(0.5), 0.0, 0.0});
    run.scans.push_back(last);
    run.scans.back().stamp = run.odometry.back().stamp;
  }
  const Calibration found = CalibrateFromPairs(testing::Arrange(world, run), {});
  EXPECT_NEAR(found.sensor.sd_range_m, options.sensor.sd_range_m, 0.2 * options.sensor.sd_range_m);
  EXPECT_NEAR(found.sensor.sd_bearing_rad,
              options.sensor.sd_bearing_rad,
              0.4 * options.sensor.sd_bearing_rad);
}

// A vehicle that stands says nothing of its odometry: what is known of the fleet stays.
TEST(CalibrateFromPairs, WhatMotionDoesNotTellIsTheFallback) {
  OpenWorldOptions options = testing::SmallWorld(2);
  options.runs = 1;
  const SimulatedWorld world = testing::Simulate(options);
  shiftmap::Run run = world.runs[0].run;
  for (OdometrySample& sample : run.odometry) sample.v_mps = sample.omega_radps = 0.0;
  for (Scan& scan : run.scans) scan.observations = run.scans.front().observations;
  ASSERT_FALSE(run.scans.front().observations.empty());
  Calibration fallback;
  fallback.odometry.lag_s = 0.1;
  fallback.odometry.scale_v = 1.1;
  const OdometryCalibration found =
      CalibrateFromPairs(testing::Arrange(world, run), fallback).odometry;
  EXPECT_NEAR(found.lag_s, 0.1, 1e-9);
  EXPECT_NEAR(found.scale_v, 1.1, 1e-9);
  EXPECT_NEAR(found.scale_omega, 1.0, 1e-9);
}

TEST(CalibrateFromPairs, TooFewPairsLeaveTheFallback) {
  OpenWorldOptions options = testing::SmallWorld(1);
  options.runs = 1;
  options.duration_s = 4.0;
  const SimulatedWorld world = testing::Simulate(options);
  Calibration fallback{{}, options.sensor};
  fallback.odometry.scale_v = 1.23;
  fallback.odometry.lag_s = 0.34;
  const Calibration found =
      CalibrateFromPairs(testing::Arrange(world, world.runs[0].run), fallback);
  EXPECT_EQ(found.odometry.scale_v, 1.23);
  EXPECT_EQ(found.odometry.lag_s, 0.34);
  EXPECT_EQ(found.sensor.sd_range_m, options.sensor.sd_range_m);
}

}  // namespace
}  // namespace shiftmap

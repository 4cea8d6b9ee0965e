// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/vehicle_calibration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

#include "mapper/frontend/frame_motions.h"
#include "mapper/mapper.h"
#include "mapstore/geometry/angle.h"
#include "proto/core/check.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"
#include "tools/sim/landmark_sensor.h"
#include "tools/sim/odometry_motion.h"
#include "tools/sim/random.h"

namespace shiftmap {
namespace {

MapperResult Build(const std::vector<MapperInput>& inputs, const MapperOptions& options = {}) {
  StatusOr<MapperResult> result = BuildMap(inputs, std::nullopt, options);
  SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
  return *std::move(result);
}

OpenWorldOptions TestSite(std::uint64_t seed, int runs) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.runs = runs;
  options.mode_change_probability = 0.1;
  options.odometry.scale_v = 1.03;
  options.odometry.scale_omega = 0.96;
  options.odometry.lag_s = 0.2;
  options.odometry.noise_v = 0.02;
  options.odometry.noise_omega = 0.015;
  return options;
}

// How often the intervals hold the truth, by parameter.
struct Coverage {
  int held = 0;
  int count = 0;

  void Add(const Interval& interval, double truth) {
    held += interval.low <= truth && truth <= interval.high ? 1 : 0;
    ++count;
  }
};

TEST(CalibrateVehicles, NinetyFivePercentHoldTheTruth) {
  constexpr int kSites = 12;
  constexpr double kBearingOffset[] = {0.03, -0.02};
  std::map<std::string, Coverage> coverage;
  double noise_v_ratio = 0.0;
  for (std::uint64_t seed = 1; seed <= kSites; ++seed) {
    const OpenWorldOptions options = TestSite(seed, 4);
    std::vector<MapperInput> inputs = testing::Inputs(testing::Simulate(options));
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      for (Scan& scan : inputs[i].run.scans) {
        for (Observation& observation : scan.observations) {
          observation.z.y() = WrapAngle(observation.z.y() + kBearingOffset[i % 2]);
        }
      }
    }
    const std::vector<VehicleEstimate> vehicles = Build(inputs).vehicles;
    ASSERT_EQ(vehicles.size(), 2u);
    for (std::size_t v = 0; v < 2; ++v) {
      EXPECT_EQ(vehicles[v].runs, 2);
      coverage["scale_v"].Add(vehicles[v].scale_v, options.odometry.scale_v);
      coverage["scale_omega"].Add(vehicles[v].scale_omega, options.odometry.scale_omega);
      coverage["lag"].Add(vehicles[v].lag_s, options.odometry.lag_s);
      noise_v_ratio += vehicles[v].noise_v.value / options.odometry.noise_v / (2.0 * kSites);
      coverage["noise_omega"].Add(vehicles[v].noise_omega, options.odometry.noise_omega);
      coverage["bearing_offset"].Add(vehicles[v].bearing_offset_rad, kBearingOffset[v]);
      coverage["range_curvature"].Add(vehicles[v].range_curvature_per_rad2, 0.0);
      coverage["sd_range"].Add(vehicles[v].sd_range_m, options.sensor.sd_range_m);
      // Its interval is of the scatter alone; see the header.
      EXPECT_NEAR(vehicles[v].sd_bearing_rad.value / options.sensor.sd_bearing_rad, 1.0, 0.15);
      coverage["detection"].Add(vehicles[v].detection_probability,
                                options.sensor.detection_probability);
    }
  }
  // Steps of millimetres, seen by ranges of decimetres; its interval too is of the scatter alone.
  EXPECT_NEAR(noise_v_ratio, 1.0, 0.35);
  RecordProperty("noise_v_ratio", std::to_string(noise_v_ratio));
  for (const auto& [name, of] : coverage) {
    RecordProperty(name, of.held);
    // 23 of 24 are to be expected; less than 19 has a probability of 0.1 %.
    EXPECT_GE(of.held, 19) << name;
  }
}

OpenWorldOptions WithGoodSensor(std::uint64_t seed) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.runs = 1;
  options.modes_per_group = 1;
  options.odometry.lag_s = 0.1;
  options.odometry.noise_v = 0.03;  // Slip, about as much as AddNoise() adds along the way.
  options.sensor.sd_range_m = 0.02;
  options.sensor.sd_bearing_rad = 0.005;
  return options;
}

// White noise of samples, which the motion does not have.
void AddNoise(std::uint64_t seed, shiftmap::Run* run) {
  Random random = MakeRandom(seed, 100);
  for (OdometrySample& sample : run->odometry) {
    sample.v_mps += Gaussian(0.1, &random);
    sample.omega_radps += Gaussian(0.05, &random);
  }
}

// Round a circle at one speed.
shiftmap::Run SteadyRun(const OpenWorldOptions& options, const SimulatedWorld& world) {
  constexpr Velocity kVelocity{1.0, 0.2};
  constexpr int kScanEvery = 4;
  Random random = MakeRandom(options.seed, 101);
  const double tick_s = 1.0 / options.odometry_rate_hz;
  shiftmap::Run run;
  run.info = world.runs[0].run.info;
  StampedPose pose{options.start, Se2(0.5 * options.size_m, 2.0, 0.0)};
  for (int tick = 0; tick * tick_s < options.duration_s; ++tick) {
    run.odometry.push_back({pose.stamp, kVelocity.v_mps, kVelocity.omega_radps});
    if (tick % kScanEvery == 0) {
      run.scans.push_back(SenseLandmarks(
          world.groups, world.runs[0].active_mode, pose, options.sensor, 0.0, {}, &random));
    }
    pose.stamp += FromSeconds(tick_s);
    pose.T_map_vehicle =
        pose.T_map_vehicle * TrueMotion(kVelocity, tick_s, options.odometry, &random);
  }
  return run;
}

TEST(CalibrateVehicles, NoiseOfOdometryDoesNotPassForALag) {
  constexpr int kRuns = 60;
  Coverage coverage;
  double squared_error = 0.0;
  for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
    const OpenWorldOptions options = WithGoodSensor(seed);
    std::vector<MapperInput> inputs = testing::Inputs(testing::Simulate(options));
    AddNoise(seed, &inputs[0].run);
    const Interval lag = Build(inputs).vehicles.front().lag_s;
    coverage.Add(lag, options.odometry.lag_s);
    squared_error += std::pow(lag.value - options.odometry.lag_s, 2);
  }
  RecordProperty("held", coverage.held);
  RecordProperty("rms_s", std::to_string(std::sqrt(squared_error / kRuns)));
  EXPECT_GE(coverage.held, 52);  // Of 57 to be expected.
  EXPECT_LT(std::sqrt(squared_error / kRuns), 0.008);
}

TEST(CalibrateVehicles, ASteadyDriveTellsNoLag) {
  constexpr int kRuns = 60;
  Coverage coverage;
  for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
    const OpenWorldOptions options = WithGoodSensor(seed);
    const SimulatedWorld world = testing::Simulate(options);
    MapperInput input = testing::Inputs(world)[0];
    input.run = SteadyRun(options, world);
    AddNoise(seed, &input.run);
    const Interval lag = Build({input}).vehicles.front().lag_s;
    EXPECT_GT(lag.high - lag.low, 0.9 * 2.0 * 1.96 * kLagSd) << seed;
    // One speed goes with any lag.
    Random random = MakeRandom(seed, 102);
    coverage.Add(lag, Gaussian(kLagSd, &random));
  }
  RecordProperty("held", coverage.held);
  EXPECT_GE(coverage.held, 52);  // Of 57 to be expected.
}

TEST(CalibrateVehicles, MoreRunsTellMore) {
  const std::vector<MapperInput> inputs = testing::Inputs(testing::Simulate(TestSite(3, 6)));
  const auto width = [](const Interval& interval) { return interval.high - interval.low; };
  const VehicleEstimate few = Build({inputs[0], inputs[1]}).vehicles.front();
  const VehicleEstimate many = Build(inputs).vehicles.front();
  EXPECT_EQ(few.runs, 1);
  EXPECT_EQ(many.runs, 3);
  EXPECT_LT(width(many.scale_v), width(few.scale_v));
  EXPECT_LT(width(many.lag_s), width(few.lag_s));
  EXPECT_LT(width(many.bearing_offset_rad), width(few.bearing_offset_rad));
  EXPECT_LT(width(many.noise_v), width(few.noise_v));
  EXPECT_LT(width(many.detection_probability), width(few.detection_probability));
}

// Alone a vehicle does not tell how long a metre is, and what was known beforehand remains. With
// another one it tells by how much their ranges differ, and half of the variance remains.
TEST(CalibrateVehicles, ScaleOfRangesIsToldByAMapAndByOtherVehicles) {
  std::vector<MapperInput> inputs = testing::Inputs(testing::Simulate(TestSite(3, 6)));
  constexpr double kLonger[] = {0.01, -0.01};  // Than a metre.
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    for (Scan& scan : inputs[i].run.scans) {
      for (Observation& observation : scan.observations) {
        observation.z.x() *= std::exp(kLonger[i % 2]);
      }
    }
  }
  MapperOptions options;
  constexpr double kQuantile = 1.959964;  // Of 97.5 %.
  const Interval& alone = Build({inputs[0]}, options).vehicles.front().range_scale;
  EXPECT_NEAR(alone.value, 1.0, 1e-9);
  EXPECT_NEAR(std::log(alone.low), -kQuantile * options.sd_run_range_scale, 1e-6);
  EXPECT_NEAR(std::log(alone.high), kQuantile * options.sd_run_range_scale, 1e-6);

  const MapperResult first = Build({inputs[0], inputs[1]}, options);
  ASSERT_EQ(first.vehicles.size(), 2u);
  const double width = 2.0 * kQuantile * options.sd_run_range_scale / std::sqrt(2.0);
  for (std::size_t v = 0; v < 2; ++v) {
    const Interval& scale = first.vehicles[v].range_scale;
    EXPECT_NEAR(std::log(scale.value), kLonger[v], 0.002) << v;
    EXPECT_NEAR(std::log(scale.high / scale.low), width, 0.1 * width) << v;
  }
  const StatusOr<MapperResult> second = BuildMap({inputs[2]}, first.content, options);
  ASSERT_THAT(second, testing::IsOk());
  const Interval& scale = second->vehicles.front().range_scale;
  EXPECT_GT(std::abs(scale.value - 1.0), 1e-5);
  EXPECT_LT(std::log(scale.high / scale.low), 1.9 * kQuantile * options.sd_run_range_scale);
}

TEST(CalibrateVehicles, NothingIsSaidWithoutCalibration) {
  MapperOptions options;
  options.calibrate = false;
  EXPECT_TRUE(
      Build(testing::Inputs(testing::Simulate(testing::SmallWorld(1))), options).vehicles.empty());
}

}  // namespace
}  // namespace shiftmap

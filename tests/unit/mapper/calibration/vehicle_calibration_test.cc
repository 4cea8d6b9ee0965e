// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/vehicle_calibration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

#include "mapper/mapper.h"
#include "mapstore/geometry/angle.h"
#include "proto/core/check.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

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

// Without a map nothing tells how long a metre is, and what was known beforehand remains.
TEST(CalibrateVehicles, ScaleOfRangesIsToldByAMap) {
  const std::vector<MapperInput> inputs = testing::Inputs(testing::Simulate(TestSite(3, 6)));
  MapperOptions options;
  const MapperResult first = Build({inputs[0], inputs[1]}, options);
  constexpr double kQuantile = 1.959964;  // Of 97.5 %.
  for (const VehicleEstimate& vehicle : first.vehicles) {
    EXPECT_NEAR(vehicle.range_scale.value, 1.0, 1e-9);
    EXPECT_NEAR(std::log(vehicle.range_scale.low), -kQuantile * options.sd_run_range_scale, 1e-6);
    EXPECT_NEAR(std::log(vehicle.range_scale.high), kQuantile * options.sd_run_range_scale, 1e-6);
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

// SPDX-License-Identifier: Apache-2.0
#include "localizer/initialization/global_start.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

std::vector<WindowScan> WindowOf(const MapContent& content, const SimulatedRun& simulated) {
  OdometryBuffer odometry(content.calibration.odometry);
  for (const OdometrySample& sample : simulated.run.odometry) odometry.Add(sample);
  std::vector<WindowScan> window;
  for (const Scan& scan : simulated.run.scans) {
    window.push_back({scan, odometry.Take(scan.stamp)});
  }
  return window;
}

TEST(GlobalStart, FindsThePoseWhateverModesHold) {
  const MapContent content = MakeTwoModeMap(15, 14.0, 33);
  const MapSnapshot snapshot = Snapshot(content);
  std::vector<int> states(content.groups.size(), 2);
  for (std::size_t i = 0; i < states.size(); i += 5) states[i] = 1;
  int found = 0;
  double nees = 0.0;
  constexpr int kRuns = 40;
  for (int i = 0; i < kRuns; ++i) {
    SimulationOptions options;
    options.seed = 500 + static_cast<std::uint64_t>(i);
    options.duration_s = 12.0;
    options.clutter_share = 0.05;
    options.T_map_start = Se2(0.1 * i - 2.0, 1.0 - 0.05 * i, 0.7 * i);
    const SimulatedRun simulated = Simulate(content, PositionsOf(content, states), options);
    const auto start = FindGlobalStart(WindowOf(content, simulated), snapshot, {});
    if (!start) continue;
    ++found;
    const Eigen::Vector3d error = (start->pose.T_map_vehicle.Inverse() * options.T_map_start).Log();
    const double squared = error.dot(start->pose.cov_T_map_vehicle.inverse() * error);
    EXPECT_LT(squared, ChiSquareQuantile(0.9999, 3)) << i;
    EXPECT_LT(error.head<2>().norm(), 1.5) << i;
    nees += squared;
  }
  EXPECT_GT(found, kRuns / 2);
  EXPECT_LT(nees / found, 4.0);  // The covariance is honest: 3 expected, or less.
}

TEST(GlobalStart, DoesNotGuess) {
  const MapContent content = MakeTwoModeMap(15, 14.0, 33);
  const MapSnapshot snapshot = Snapshot(content);
  std::vector<WindowScan> window(1);
  for (const int group : {0, 1}) {
    Observation observation;
    observation.signature = content.groups[static_cast<std::size_t>(group)].signature;
    observation.z = {3.0, 0.3 * group};
    window[0].scan.observations.push_back(observation);
  }
  EXPECT_FALSE(FindGlobalStart(window, snapshot, {}));
}

TEST(GlobalStart, KeepsCollectingWhenTwoPlacesLookAlike) {
  // Every landmark's second mode is its first one, 20 m further: the vehicle may be in either copy.
  MapContent content = MakeTwoModeMap(6, 10.0, 3);
  for (LandmarkGroup& group : content.groups) {
    group.modes[1].p_map_landmark = group.modes[0].p_map_landmark + Eigen::Vector2d(20.0, 0.0);
  }
  content.calibration.sensor.max_bearing_rad = 3.1;
  SimulationOptions options;
  options.duration_s = 10.0;
  const std::vector<int> states(content.groups.size(), 1);
  const SimulatedRun simulated = Simulate(content, PositionsOf(content, states), options);
  EXPECT_FALSE(FindGlobalStart(WindowOf(content, simulated), Snapshot(content), {}));
}

}  // namespace
}  // namespace shiftmap

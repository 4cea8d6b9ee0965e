// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/noise_calibration.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace shiftmap {
namespace {

TEST(PoolNoiseByVehicle, TakesTheMedianOfEachVehicle) {
  const std::vector<std::string> vehicles = {"a", "b", "a", "b", "a"};
  const std::vector<double> noise = {0.01, 0.05, 0.9, 0.05, 0.02};
  std::vector<MappingRun> data(vehicles.size());
  BuildState build;
  for (std::size_t i = 0; i < vehicles.size(); ++i) {
    data[i].info.vehicle = vehicles[i];
    BuildRun run;
    run.data = &data[i];
    run.odometry.noise_v = noise[i];
    run.odometry.noise_omega = 10.0 * noise[i];
    build.runs.push_back(run);
  }
  PoolNoiseByVehicle(&build);
  for (std::size_t i = 0; i < vehicles.size(); ++i) {
    const double expected = vehicles[i] == "a" ? 0.02 : 0.05;
    const OdometryCalibration& pooled = build.runs[RunIndex(i)].odometry;
    EXPECT_EQ(pooled.noise_v, expected) << i;
    EXPECT_EQ(pooled.noise_omega, 10.0 * expected) << i;
  }
}

}  // namespace
}  // namespace shiftmap

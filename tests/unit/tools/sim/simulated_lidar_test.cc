// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/simulated_lidar.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/ray_caster.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

// A long wall 4 m ahead.
const std::vector<Wall>& LongWall() {
  static const std::vector<Wall> walls = {{{4.0, -1000.0}, {4.0, 1000.0}}};
  return walls;
}

SimulatedLidar HalfCircle() {
  SimulatedLidar lidar;
  lidar.beams = 61;
  return lidar;
}

TEST(SimulatedLidar, WithoutNoiseReadsWhatBruteForceReads) {
  SimulatedLidar lidar = HalfCircle();
  lidar.noise = {.base_sd_m = 0.0, .sd_per_m = 0.0, .grazing_cos = 0.0};
  lidar.sensor.T_vehicle_lidar = Se2(1.0, 0.3, 0.2);
  const Se2 T_map_vehicle(0.5, -0.7, -0.4);
  Random random = MakeRandom(1, 0);
  std::vector<double> ranges(61);
  TakeRanges(RayCaster(LongWall()), lidar, T_map_vehicle, &random, ranges);
  const std::vector<double> expected =
      CastScan(LongWall(), T_map_vehicle * lidar.sensor.T_vehicle_lidar, 61, lidar.sensor);
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    EXPECT_NEAR(ranges[i], std::min(expected[i], lidar.sensor.max_range_m), 1e-9);
  }
}

TEST(SimulatedLidar, NoiseAndDropoutsAreAsStated) {
  constexpr int kScans = 4000;
  SimulatedLidar lidar = HalfCircle();
  lidar.noise = {.base_sd_m = 0.02, .sd_per_m = 0.005, .min_cos = 0.25, .grazing_cos = 0.3};
  const RayCaster caster(LongWall());
  Random random = MakeRandom(1, 0);
  std::vector<double> ranges(61);
  std::vector<double> sum2(61, 0.0);
  std::vector<int> returns(61, 0);
  const auto cosine = [&](std::size_t beam) { return std::cos(lidar.sensor.Bearing(beam, 61)); };
  for (int scan = 0; scan < kScans; ++scan) {
    TakeRanges(caster, lidar, Se2(), &random, ranges);
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      if (!lidar.sensor.Returned(ranges[i])) continue;
      ++returns[i];
      sum2[i] += std::pow(ranges[i] - 4.0 / cosine(i), 2);
    }
  }
  for (std::size_t i = 2; i < 59; ++i) {
    const double c = cosine(i);
    const double expected = c < 0.3 ? c / 0.3 : 1.0;
    // Four standard deviations of a share.
    EXPECT_NEAR(returns[i] / double{kScans}, expected, 0.033) << i;
    const double sd = (0.02 + 0.005 * 4.0 / c) / std::max(c, 0.25);
    EXPECT_NEAR(std::sqrt(sum2[i] / returns[i]), sd, 0.08 * sd) << i;
  }
  EXPECT_EQ(returns[0], 0) << "along the wall";
}

TEST(SimulatedLidar, RefusesOptionsOutOfRange) {
  SimulatedLidar lidar;
  EXPECT_THAT(lidar.Validate(), IsOk());
  lidar.beams = 1;
  EXPECT_THAT(lidar.Validate(), StatusIs(StatusCode::kInvalidArgument, "beams = 1"));
  lidar = {};
  lidar.noise.min_cos = 0.0;
  EXPECT_THAT(lidar.Validate(), StatusIs(StatusCode::kInvalidArgument, "least cosine = 0"));
  lidar = {};
  lidar.noise.grazing_cos = 1.5;
  EXPECT_THAT(lidar.Validate(), StatusIs(StatusCode::kInvalidArgument, "grazing cosine"));
}

}  // namespace
}  // namespace shiftmap

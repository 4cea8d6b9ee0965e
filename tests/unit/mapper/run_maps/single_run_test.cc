// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/single_run.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// A vehicle that sees new ground for minutes before it comes back to what it knows, with odometry
// five times as good as assumed.
OpenWorldOptions LargeFloor(std::uint64_t seed) {
  OpenWorldOptions options;
  options.seed = seed;
  options.runs = 1;
  options.groups = 700;
  options.size_m = 240.0;
  options.duration_s = 1000.0;
  options.scan_rate_hz = 2.0;
  options.odometry.noise_v = 0.01;
  options.odometry.noise_omega = 0.01;
  return options;
}

// As many landmarks per square metre, of another number, for another time, with such odometry.
OpenWorldOptions FloorOf(int groups, double duration_s, double noise_omega, std::uint64_t seed) {
  OpenWorldOptions options = LargeFloor(seed);
  options.size_m *= std::sqrt(static_cast<double>(groups) / options.groups);
  options.groups = groups;
  options.duration_s = duration_s;
  options.odometry.noise_omega = noise_omega;
  return options;
}

// A filter that took the odometry for as bad as that would close loops by turning the map, and what
// follows would take the twist for noise.
TEST(MapSingleRun, LongWaysBetweenTwoLooksDoNotTwistIt) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const SimulatedWorld world = testing::Simulate(LargeFloor(seed));
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    const OdometryCalibration& odometry = build.runs[0].odometry;
    const double error =
        testing::AlignedRmse(build.runs[0].poses, testing::TruePoses(world.runs[0], run));
    EXPECT_LT(odometry.noise_omega, 0.025) << seed;
    EXPECT_LT(error, 4.0) << seed;
  }
}

// Odometry so noisy that the vehicle comes back with its heading off by more than a radian.
TEST(MapSingleRun, AVehicleThatComesBackLostMakesNoSecondMap) {
  int lost = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    OpenWorldOptions options = LargeFloor(seed);
    options.groups = 200;
    options.size_m = 126.0;
    options.odometry.noise_v = 0.05;
    options.odometry.noise_omega = 0.05;
    const SimulatedWorld world = testing::Simulate(options);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    const std::vector<Se2> truth = testing::TruePoses(world.runs[0], run);
    EXPECT_LT(testing::AlignedRmse(build.runs[0].poses, truth), 1.5) << seed;
    for (const GroupModes& modes : build.modes) EXPECT_LE(modes.size(), 1u) << seed;
    const double turned = (truth.front().Inverse() * truth.back()).yaw() -
                          DeadReckon(build.runs[0].motions).back().yaw();
    lost += std::abs(Se2(0.0, 0.0, turned).yaw()) > 1.0;
  }
  EXPECT_GE(lost, 2);
}

// A vehicle that comes back metres beside where odometry has it was not carried, and nothing moved.
TEST(MapSingleRun, AVehicleThatComesBackFromAfarWasNotCarried) {
  for (std::uint64_t seed = 1; seed <= 24; ++seed) {
    const SimulatedWorld world =
        seed % 2 == 0 ? testing::TwoHalls(seed, 1) : testing::LongLoop(seed);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    EXPECT_TRUE(BrokenMotions(build.runs[0].motions).empty()) << seed;
    for (const GroupModes& modes : build.modes) EXPECT_LE(modes.size(), 1u) << seed;
  }
}

// Hours over many landmarks, of which the way back to the first ones is long: mapped in parts.
TEST(MapSingleRun, AShiftOverManyLandmarksIsOneMap) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SimulatedWorld world = testing::Simulate(FloorOf(500, 5400.0, 0.02, seed));
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    EXPECT_LT(testing::AlignedRmse(build.runs[0].poses, testing::TruePoses(world.runs[0], run)),
              1.0)
        << seed;
    for (const GroupModes& modes : build.modes) EXPECT_LE(modes.size(), 1u) << seed;
  }
}

// A vehicle that stands says nothing of the noise of driving, however long, and what it sees again
// and again makes no distortion of the sensor out of noise.
TEST(MapSingleRun, ALongStandLeavesTheCalibrationAsItIs) {
  testing::MapConsistency maps;
  double noise_v = 0.0;
  double noise_omega = 0.0;
  constexpr int kWorlds = 4;
  for (std::uint64_t seed = 1; seed <= kWorlds; ++seed) {
    const SimulatedWorld world = testing::LongStand(seed, 1200.0);
    const StatusOr<MapperResult> map = BuildMap(testing::Inputs(world), std::nullopt, {});
    ASSERT_THAT(map, testing::IsOk()) << seed;
    maps.Add(testing::MeasureConsistency(map->content, world));
    noise_v += map->runs[0].odometry.noise_v / kWorlds;
    noise_omega += map->runs[0].odometry.noise_omega / kWorlds;
  }
  EXPECT_NEAR(noise_v, 0.02, 0.004);
  EXPECT_NEAR(noise_omega, 0.02, 0.002);
  EXPECT_LT(maps.nees, ChiSquareQuantile(0.9995, maps.dof));
}

// What odometry did not measure is no error of its scales or its stamps, and not its noise.
TEST(MapSingleRun, AGapInOdometryLeavesTheCalibrationAsItIs) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const SimulatedWorld world = testing::StaticWorld(seed);
    const Stamp begin = world.runs[0].truth.front().stamp;
    double noise_v = 0.0;
    double noise_omega = 0.0;
    // None; in the middle, short and long; and at the begin.
    for (const auto& [from_s, gap_s] : {std::pair(50, 0),
                                        std::pair(50, 3),
                                        std::pair(50, 5),
                                        std::pair(50, 30),
                                        std::pair(-1, 7)}) {
      std::vector<MapperInput> inputs = testing::Inputs(world);
      std::erase_if(inputs[0].run.odometry, [&](const OdometrySample& sample) {
        const double since_s = ToSeconds(sample.stamp - begin);
        return since_s > from_s && since_s < from_s + gap_s;
      });
      const StatusOr<MapperResult> map = BuildMap(std::move(inputs), std::nullopt, {});
      ASSERT_THAT(map, testing::IsOk()) << seed;
      const OdometryCalibration& odometry = map->runs[0].odometry;
      if (gap_s == 0) {
        noise_v = odometry.noise_v;
        noise_omega = odometry.noise_omega;
      }
      EXPECT_NEAR(std::log(odometry.noise_v / noise_v), 0.0, 0.6) << seed << ", " << gap_s << " s";
      EXPECT_NEAR(std::log(odometry.noise_omega / noise_omega), 0.0, 0.6)
          << seed << ", " << gap_s << " s";
      EXPECT_NEAR(odometry.scale_v, 1.0, 0.02) << seed << ", " << gap_s << " s";
      EXPECT_NEAR(odometry.scale_omega, 1.0, 0.02) << seed << ", " << gap_s << " s";
      EXPECT_NEAR(odometry.lag_s, 0.0, 0.03) << seed << ", " << gap_s << " s";
    }
  }
}

// Where the way is short, noise of odometry may explain it as well.
TEST(MapSingleRun, AVehicleThatWasCarriedMakesNoSecondMap) {
  int broken = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const SimulatedWorld world = testing::StaticWorld(seed);
    const Stamp begin = world.runs[0].truth.front().stamp;
    const SimulatedRun carried = testing::CarriedMeanwhile(
        world.runs[0], begin + std::chrono::seconds(80), begin + std::chrono::seconds(120));
    const MappingRun run = testing::Arrange(world, carried.run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    EXPECT_LT(testing::AlignedRmse(build.runs[0].poses, testing::TruePoses(carried, run)), 1.0)
        << seed;
    for (const GroupModes& modes : build.modes) EXPECT_LE(modes.size(), 1u) << seed;
    for (const FrameIndex motion : BrokenMotions(build.runs[0].motions)) {
      EXPECT_LT(ToSeconds(run.frames[motion].stamp - begin), 82.0) << seed;
      EXPECT_GT(ToSeconds(run.frames[motion + 1].stamp - begin), 78.0) << seed;
      ++broken;
    }
  }
  EXPECT_GE(broken, 4);
}

TEST(MapSingleRun, ABuildSaysThatTheVehicleWasCarried) {
  const SimulatedWorld world = testing::StaticWorld(1);
  const Stamp begin = world.runs[0].truth.front().stamp;
  std::vector<MapperInput> inputs = testing::Inputs(world);
  const StatusOr<MapperResult> whole = BuildMap(inputs, std::nullopt, {});
  ASSERT_THAT(whole, testing::IsOk());
  EXPECT_TRUE(whole->runs[0].moved.empty());
  inputs[0].run =
      testing::CarriedMeanwhile(
          world.runs[0], begin + std::chrono::seconds(80), begin + std::chrono::seconds(120))
          .run;
  const StatusOr<MapperResult> carried = BuildMap(inputs, std::nullopt, {});
  ASSERT_THAT(carried, testing::IsOk());
  ASSERT_EQ(carried->runs[0].moved.size(), 1u);
  EXPECT_NEAR(ToSeconds(carried->runs[0].moved[0] - begin), 80.0, 5.0);
}

// Half of the landmarks move by the same way in the middle of a run, as on a rack, and the rest
// stays.
TEST(MapSingleRun, LandmarksThatMoveTogetherMoveAndNotTheVehicle) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const SimulatedWorld world = testing::StaticWorld(seed);
    SimulatedRun moved = world.runs[0];
    for (Scan& scan : moved.run.scans) {
      if (ToSeconds(scan.stamp - moved.truth.front().stamp) < 100.0) continue;
      const auto pose = std::find_if(moved.truth.begin(), moved.truth.end(), [&](const auto& at) {
        return at.stamp == scan.stamp;
      });
      for (Observation& observation : scan.observations) {
        if (observation.signature.text() > world.groups[5].signature.text()) continue;
        const Se2& T_map_vehicle = pose->T_map_vehicle;
        const Eigen::Vector2d p =
            T_map_vehicle.Inverse() *
            (T_map_vehicle * observation.PositionInVehicle() + Eigen::Vector2d(2.0, 1.0));
        observation.z = {p.norm(), std::atan2(p.y(), p.x())};
      }
    }
    const MappingRun run = testing::Arrange(world, moved.run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    EXPECT_TRUE(BrokenMotions(build.runs[0].motions).empty()) << seed;
    EXPECT_LT(testing::AlignedRmse(build.runs[0].poses, testing::TruePoses(moved, run)), 0.1)
        << seed;
  }
}

// Wherever it is stopped, what is left is the run and none of its parts.
TEST(MapSingleRun, IsTheRunWhereverItIsStopped) {
  const SimulatedWorld world = testing::Simulate(FloorOf(300, 1200.0, 0.05, 1));
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  int calls = 0;
  MapSingleRun(run, world.groups.size(), {}, [&](const BuildState&) { return ++calls > 0; });
  ASSERT_GT(calls, 20);
  for (int stop = 0; stop < calls; stop += 5) {
    int asked = 0;
    const BuildState build = MapSingleRun(
        run, world.groups.size(), {}, [&](const BuildState&) { return asked++ < stop; });
    EXPECT_LE(asked, calls);
    ASSERT_EQ(build.runs.size(), 1u);
    EXPECT_EQ(build.runs[0].data, &run);
    EXPECT_EQ(build.runs[0].poses.size(), run.frames.size());
  }
}

}  // namespace
}  // namespace shiftmap

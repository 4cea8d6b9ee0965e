// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/open_world.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "mapstore/codec/run_log.h"
#include "mapstore/geometry/angle.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/sim/world_files.h"

namespace shiftmap {
namespace {

using testing::IsNearPose;
using testing::IsOk;
using testing::StatusIs;

OpenWorldOptions SmallWorld() {
  OpenWorldOptions options;
  options.seed = 5;
  options.groups = 15;
  options.size_m = 25.0;
  options.duration_s = 120.0;
  options.runs = 2;
  return options;
}

TEST(OpenWorld, TheSameSeedGivesTheSameBits) {
  const testing::TempDir dir;
  ASSERT_THAT(WriteWorld(*SimulateOpen(SmallWorld()), dir.File("a")), IsOk());
  ASSERT_THAT(WriteWorld(*SimulateOpen(SmallWorld()), dir.File("b")), IsOk());
  OpenWorldOptions other = SmallWorld();
  other.seed = 6;
  ASSERT_THAT(WriteWorld(*SimulateOpen(other), dir.File("c")), IsOk());
  for (const char* file : {"run_000.mcap",
                           "run_001.mcap",
                           "run_001.truth.tum",
                           "run_001.places.csv",
                           "truth.csv",
                           "modes.csv"}) {
    const std::string name = std::string("/") + file;
    EXPECT_EQ(testing::ReadFile(dir.File("a") + name), testing::ReadFile(dir.File("b") + name));
    EXPECT_NE(testing::ReadFile(dir.File("a") + name), testing::ReadFile(dir.File("c") + name));
  }
}

TEST(OpenWorld, RunsAreValidAndSurviveTheFile) {
  const auto world = SimulateOpen(SmallWorld());
  ASSERT_THAT(world, IsOk());
  const testing::TempDir dir;
  const auto paths = WriteWorld(*world, dir.File("world"));
  ASSERT_THAT(paths, IsOk());
  ASSERT_EQ(paths->size(), 2U);
  for (std::size_t r = 0; r < 2; ++r) {
    const shiftmap::Run& run = world->runs[r].run;
    EXPECT_THAT(ValidateRun(run), IsOk());
    EXPECT_EQ(run.scans.size(), 601U);
    const auto log = ReadRunLog((*paths)[r]);
    ASSERT_THAT(log, IsOk());
    EXPECT_EQ(log->run.odometry.size(), run.odometry.size());
    EXPECT_EQ(log->run.scans.size(), run.scans.size());
  }
}

TEST(OpenWorld, WithoutNoiseOdometryIntegratesToTheTruth) {
  OpenWorldOptions options = SmallWorld();
  options.odometry = {.scale_v = 0.9, .scale_omega = 1.1, .noise_v = 0.0, .noise_omega = 0.0};
  const auto world = SimulateOpen(options);
  ASSERT_THAT(world, IsOk());
  const SimulatedRun& run = world->runs.front();
  Se2 pose = run.truth.front().T_map_vehicle;
  for (std::size_t i = 0; i + 1 < run.truth.size(); ++i) {
    const OdometrySample& sample = run.run.odometry[i];
    const double dt = ToSeconds(run.truth[i + 1].stamp - sample.stamp);
    pose = pose * Se2::Exp({0.9 * sample.v_mps * dt, 0.0, 1.1 * sample.omega_radps * dt});
  }
  EXPECT_THAT(pose, IsNearPose(run.truth.back().T_map_vehicle, 1e-6));
}

TEST(OpenWorld, MotionNoiseIsARandomWalkOfTheStatedSize) {
  OpenWorldOptions options = SmallWorld();
  options.duration_s = 1000.0;
  options.odometry.noise_v = 0.05;
  options.odometry.noise_omega = 0.02;
  const auto world = SimulateOpen(options);
  ASSERT_THAT(world, IsOk());
  const SimulatedRun& run = world->runs.front();
  Eigen::Vector3d sum2 = Eigen::Vector3d::Zero();
  const std::size_t steps = run.truth.size() - 1;
  for (std::size_t i = 0; i < steps; ++i) {
    const OdometrySample& sample = run.run.odometry[i];
    const double dt = ToSeconds(run.truth[i + 1].stamp - sample.stamp);
    const Se2 moved = run.truth[i].T_map_vehicle.Inverse() * run.truth[i + 1].T_map_vehicle;
    const Eigen::Vector3d error =
        moved.Log() - dt * Eigen::Vector3d(sample.v_mps, 0.0, sample.omega_radps);
    sum2 += error.cwiseAbs2() / dt;
  }
  // 20 000 samples: the standard deviation of the estimate is 0.5 %.
  const Eigen::Vector3d sd = (sum2 / static_cast<double>(steps)).cwiseSqrt();
  EXPECT_NEAR(sd.x(), 0.05, 0.05 * 0.03);
  EXPECT_NEAR(sd.y(), 0.05, 0.05 * 0.03);
  EXPECT_NEAR(sd.z(), 0.02, 0.02 * 0.03);
}

// What the scans of a world say, against its truth.
struct ScanStatistics {
  int expected = 0;  ///< Landmarks in the field of view.
  int seen = 0;
  double sum_range2 = 0.0;
  double sum_bearing2 = 0.0;
  int out_of_view = 0;
  int empty_scans = 0;
};

ScanStatistics Compare(const SimulatedWorld& world, const OpenWorldOptions& options) {
  ScanStatistics statistics;
  for (const SimulatedRun& run : world.runs) {
    for (const Scan& scan : run.run.scans) {
      const auto pose = Interpolate(run.truth, scan.stamp, FromSeconds(1.0));
      statistics.empty_scans += scan.observations.empty();
      std::map<Signature, Eigen::Vector2d> visible;
      for (std::size_t g = 0; g < world.groups.size(); ++g) {
        if (run.active_mode[g] == kAbsent) continue;
        const auto mode = static_cast<std::size_t>(run.active_mode[g].value()) - 1;
        const Eigen::Vector2d q = pose->Inverse() * world.groups[g].modes[mode];
        const double bearing = std::atan2(q.y(), q.x());
        if (q.norm() < options.sensor.max_range_m &&
            std::abs(bearing) < options.sensor.max_bearing_rad) {
          visible[world.groups[g].signature] = {q.norm(), bearing};
        }
      }
      statistics.expected += static_cast<int>(visible.size());
      for (const Observation& observation : scan.observations) {
        const auto found = visible.find(observation.signature);
        if (found == visible.end()) {
          ++statistics.out_of_view;
          continue;
        }
        ++statistics.seen;
        statistics.sum_range2 += std::pow(observation.z.x() - found->second.x(), 2);
        statistics.sum_bearing2 += std::pow(WrapAngle(observation.z.y() - found->second.y()), 2);
      }
    }
  }
  return statistics;
}

TEST(OpenWorld, ObservationsHaveTheStatedNoiseAndDetectionRate) {
  OpenWorldOptions options = SmallWorld();
  options.duration_s = 1000.0;
  const auto world = SimulateOpen(options);
  ASSERT_THAT(world, IsOk());
  const ScanStatistics statistics = Compare(*world, options);
  ASSERT_GT(statistics.seen, 5000);
  EXPECT_EQ(statistics.out_of_view, 0);
  EXPECT_NEAR(std::sqrt(statistics.sum_range2 / statistics.seen), 0.1, 0.1 * 0.05);
  EXPECT_NEAR(std::sqrt(statistics.sum_bearing2 / statistics.seen), 0.02, 0.02 * 0.05);
  EXPECT_NEAR(static_cast<double>(statistics.seen) / statistics.expected, 0.8, 0.03);
  EXPECT_GT(statistics.empty_scans, 0);
}

TEST(OpenWorld, ClutterHasTheStatedRate) {
  OpenWorldOptions options = SmallWorld();
  options.duration_s = 1000.0;
  options.absent_probability = 1.0;
  options.clutter_per_scan = 0.5;
  const auto world = SimulateOpen(options);
  ASSERT_THAT(world, IsOk());
  const ScanStatistics statistics = Compare(*world, options);
  EXPECT_EQ(statistics.seen, 0);
  EXPECT_NEAR(statistics.out_of_view / 10002.0, 0.5, 0.03);
}

TEST(OpenWorld, PlacesKeepTheirDistanceAndLandmarksMove) {
  OpenWorldOptions options = SmallWorld();
  options.runs = 60;
  options.duration_s = 1.0;
  options.modes_per_group = 3;
  options.mode_gap_m = 1.5;
  options.mode_change_probability = 0.3;
  const auto world = SimulateOpen(options);
  ASSERT_THAT(world, IsOk());
  std::vector<Eigen::Vector2d> places;
  for (const SimulatedGroup& group : world->groups) {
    places.insert(places.end(), group.modes.begin(), group.modes.end());
  }
  ASSERT_EQ(places.size(), 45U);
  for (std::size_t i = 0; i < places.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) EXPECT_GE((places[i] - places[j]).norm(), 1.5);
  }
  int moved = 0;
  for (std::size_t r = 1; r < world->runs.size(); ++r) {
    for (std::size_t g = 0; g < 15; ++g) {
      moved += world->runs[r].active_mode[g] != world->runs[r - 1].active_mode[g];
    }
  }
  EXPECT_NEAR(moved / (59.0 * 15.0), 0.3, 0.06);
}

TEST(OpenWorld, ALagMovesTheMotionBehindTheLog) {
  OpenWorldOptions options = SmallWorld();
  options.odometry = {.lag_s = 0.2, .noise_v = 0.0, .noise_omega = 0.0};
  const auto world = SimulateOpen(options);
  ASSERT_THAT(world, IsOk());
  const SimulatedRun& run = world->runs.front();
  for (std::size_t i = 4; i + 1 < run.truth.size(); ++i) {
    const Se2 moved = run.truth[i].T_map_vehicle.Inverse() * run.truth[i + 1].T_map_vehicle;
    const double dt = ToSeconds(run.truth[i + 1].stamp - run.truth[i].stamp);
    EXPECT_NEAR(moved.Log().x(), run.run.odometry[i - 4].v_mps * dt, 1e-9);
  }
}

TEST(OpenWorld, LandmarksStandWhereTheyAreTold) {
  OpenWorldOptions options = SmallWorld();
  options.runs = 2;
  const auto all = static_cast<std::size_t>(options.groups);
  options.states = {std::vector<ModeNumber>(all, kAbsent),
                    std::vector<ModeNumber>(all, ModeNumber(1))};
  const StatusOr<SimulatedWorld> world = SimulateOpen(options);
  ASSERT_THAT(world, IsOk());
  const auto seen = [](const SimulatedRun& run) {
    return std::count_if(run.run.scans.begin(), run.run.scans.end(), [](const Scan& scan) {
      return !scan.observations.empty();
    });
  };
  EXPECT_EQ(seen(world->runs[0]), 0);
  EXPECT_GT(seen(world->runs[1]), 0);
  EXPECT_EQ(world->runs[1].active_mode, options.states[1]);
  options.states.pop_back();
  EXPECT_THAT(SimulateOpen(options), StatusIs(StatusCode::kInvalidArgument, "of 1 runs"));
  options.states.emplace_back(all, ModeNumber(options.modes_per_group + 1));
  EXPECT_THAT(SimulateOpen(options), StatusIs(StatusCode::kInvalidArgument, "a place or 0"));
}

TEST(OpenWorld, RefusesOptionsOutOfRange) {
  OpenWorldOptions options = SmallWorld();
  options.groups = 0;
  EXPECT_THAT(SimulateOpen(options), StatusIs(StatusCode::kInvalidArgument, "groups = 0"));
  options = SmallWorld();
  options.mode_change_probability = 1.5;
  EXPECT_THAT(SimulateOpen(options), StatusIs(StatusCode::kInvalidArgument, "0..1"));
  options = SmallWorld();
  options.mode_gap_m = 20.0;
  EXPECT_THAT(SimulateOpen(options), StatusIs(StatusCode::kInvalidArgument, "do not fit"));
}

}  // namespace
}  // namespace shiftmap

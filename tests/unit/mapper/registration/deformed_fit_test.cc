// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/deformed_fit.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <random>
#include <vector>

#include "mapper/covariance/gauge.h"
#include "mapper/run_maps/single_run.h"
#include "tests/support/random_map.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// A road of landmarks, one mode each, along which a run map drifts sideways as a random walk does.
struct Road {
  BuildState map;
  RunMap run_map;
};

constexpr int kLandmarks = 40;
constexpr double kSpacing = 5.0;   // [m]
constexpr double kDriftSd = 0.15;  // From one landmark to the next. [m]

Road MakeRoad(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd walk = Eigen::MatrixXd::Zero(2 * kLandmarks, 2 * kLandmarks);
  for (int i = 0; i < kLandmarks; ++i) {
    for (int j = 0; j <= i; ++j) walk.block<2, 2>(2 * i, 2 * j).setIdentity();
  }
  walk *= kDriftSd;
  Eigen::VectorXd drift(2 * kLandmarks);
  for (double& value : drift) value = normal(random);
  // The first landmarks are where the map has them: they hold the alignment.
  drift.head(10).setZero();
  drift = (walk * drift).eval();

  Road road;
  std::vector<Eigen::Vector2d> positions;
  road.map.modes.resize(kLandmarks);
  road.run_map.build.modes.resize(kLandmarks);
  for (int i = 0; i < kLandmarks; ++i) {
    const GroupIndex group(i);
    const Eigen::Vector2d truth(kSpacing * i, i % 2 == 0 ? 2.0 : -2.0);
    road.map.modes[group].push_back({truth, kAbsent});
    positions.emplace_back(truth + drift.segment<2>(2 * i));
    road.run_map.build.modes[group].push_back({positions.back(), kAbsent});
  }
  road.run_map.covariance = ReferToPositions(positions, walk * walk.transpose());
  return road;
}

// What a rigid transform that fits the first landmarks finds.
KnownModes RigidMatches(const Road& road, double gate_m) {
  KnownModes known;
  for (const GroupIndex i : road.map.modes.indices()) {
    const double distance =
        (road.map.modes[i][0].p_map_landmark - road.run_map.build.modes[i][0].p_map_landmark)
            .norm();
    known.push_back(distance < gate_m ? OptionalMode(GroupModeIndex(0)) : kUnassigned);
  }
  return known;
}

TEST(GrowMatches, FollowsTheBendOfALongRun) {
  std::mt19937_64 random(testing::TestSeed(95));
  const MapperOptions options;
  int rigid = 0;
  int grown = 0;
  for (int trial = 0; trial < 10; ++trial) {
    const Road road = MakeRoad(random);
    const KnownModes known = RigidMatches(road, 0.3);
    const KnownModes more =
        GrowMatches(options, road.run_map, road.map, known, ModeFlags(kLandmarks));
    for (const ModeIndex i : known.indices()) {
      EXPECT_TRUE(known[i] == kUnassigned || more[i] == known[i]) << i.value();
    }
    rigid += static_cast<int>(std::count(known.begin(), known.end(), GroupModeIndex(0)));
    grown += static_cast<int>(std::count(more.begin(), more.end(), GroupModeIndex(0)));
  }
  EXPECT_LT(rigid, 7 * kLandmarks);
  EXPECT_GT(grown, 95 * kLandmarks / 10);
}

TEST(GrowMatches, LeavesAloneWhatMovedAndWhatIsDecided) {
  std::mt19937_64 random(testing::TestSeed(96));
  const MapperOptions options;
  Road road = MakeRoad(random);
  const KnownModes known = RigidMatches(road, 0.3);
  ModeFlags fixed(kLandmarks);
  for (const GroupIndex moved : std::vector<GroupIndex>{14, 22, 35}) {
    road.map.modes[moved][0].p_map_landmark += Eigen::Vector2d(0.0, 4.0);
  }
  fixed[28] = true;
  const std::vector<ModeIndex> decided = {14, 22, 28, 35};
  const KnownModes start = [&] {
    KnownModes few = known;
    for (const ModeIndex i : decided) few[i] = kUnassigned;
    return few;
  }();
  const KnownModes more = GrowMatches(options, road.run_map, road.map, start, fixed);
  for (const ModeIndex i : decided) EXPECT_EQ(more[i], kUnassigned) << i.value();

  const auto grows_otherwise = [&](const DeformationOptions& deformation) {
    MapperOptions moved;
    moved.deformation = deformation;
    return GrowMatches(moved, road.run_map, road.map, start, fixed) != more;
  };
  EXPECT_TRUE(grows_otherwise({.first_max_sd_m = 8.0}));
  EXPECT_TRUE(grows_otherwise({.last_max_sd_m = 0.1}));
  EXPECT_TRUE(grows_otherwise({.contradiction = 0.01}));
  EXPECT_TRUE(grows_otherwise({.variance_factor = 1000.0}));
}

TEST(DeformOntoMap, BringsKnownModesAndTheTrajectoryToTheMap) {
  const SimulatedWorld world = testing::Simulate(testing::SmallWorld(7));
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const MapperOptions options;
  std::optional<RunMap> made = MakeRunMap(options, MapSingleRun(run, world.groups.size(), options));
  ASSERT_TRUE(made);
  RunMap run_map = *std::move(made);
  const BuildState straight = run_map.build;
  // The map is the run map, with one end turned a little.
  BuildState map = run_map.build;
  const auto deform = [](const Eigen::Vector2d& p) {
    return Eigen::Vector2d(p.x(), p.y() + 0.01 * p.x() * p.x());
  };
  KnownModes known;
  for (GroupModes& group : map.modes) {
    for (const GroupModeIndex m : group.indices()) {
      group[m].p_map_landmark = deform(group[m].p_map_landmark);
      known.emplace_back(m);
    }
  }
  DeformOntoMap(options, map, known, &run_map);
  double before = 0.0;
  double after = 0.0;
  for (const GroupIndex g : map.modes.indices()) {
    for (const GroupModeIndex m : map.modes[g].indices()) {
      const Eigen::Vector2d& target = map.modes[g][m].p_map_landmark;
      before += (straight.modes[g][m].p_map_landmark - target).squaredNorm();
      after += (run_map.build.modes[g][m].p_map_landmark - target).squaredNorm();
    }
  }
  EXPECT_LT(after, 0.7 * before);
  double poses_before = 0.0;
  double poses_after = 0.0;
  for (const FrameIndex f : straight.runs[0].poses.indices()) {
    const Eigen::Vector2d wanted = deform(straight.runs[0].poses[f].translation());
    poses_before += (straight.runs[0].poses[f].translation() - wanted).squaredNorm();
    poses_after += (run_map.build.runs[0].poses[f].translation() - wanted).squaredNorm();
  }
  EXPECT_LT(poses_after, poses_before);
  EXPECT_TRUE(run_map.build.priors.empty());
}

}  // namespace
}  // namespace shiftmap

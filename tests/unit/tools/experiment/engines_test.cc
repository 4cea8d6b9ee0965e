// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/engines.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/status_matchers.h"
#include "tools/sim/open_world.h"

namespace shiftmap {
namespace {

using testing::IsOk;

OpenWorldOptions SmallFloor(std::uint64_t seed) {
  OpenWorldOptions options;
  options.seed = seed;
  options.groups = 10;
  options.size_m = 12.0;
  options.mode_gap_m = 1.5;
  options.runs = 2;
  options.duration_s = 100.0;
  options.odometry_rate_hz = 10.0;
  options.scan_rate_hz = 2.5;
  options.speed_mps = 1.0;
  return options;
}

TEST(Engines, AgreeWhereNothingMoves) {
  OpenWorldOptions options = SmallFloor(1);
  options.modes_per_group = 1;
  const StatusOr<SimulatedWorld> world = SimulateOpen(options);
  ASSERT_THAT(world, IsOk());
  EnginesResult result;
  ASSERT_THAT(CompareEngines("still", 1, *world, &result), IsOk());
  ASSERT_EQ(result.sites.size(), 1u);
  const EnginesRow& row = result.sites[0];
  EXPECT_EQ(row.difference.groups, 10);
  EXPECT_EQ(row.difference.same_number, 10);
  EXPECT_EQ(row.difference.matched, 10);
  for (const EngineScore* score : {&row.graph, &row.tree}) {
    EXPECT_EQ(score->groups_right, 10);
    EXPECT_EQ(score->modes, 10);
    EXPECT_EQ(score->missing + score->spurious + score->left_out, 0);
    EXPECT_LT(std::sqrt(score->squared_m2 / score->matched), 0.1);
    EXPECT_LT(std::sqrt(score->squared_of_poses_m2 / score->poses), 0.2);
    EXPECT_GT(score->processor_s, 0.0);
  }
}

// Places that the truth does not have.
TEST(Engines, AModeWithoutAPlaceIsAnException) {
  StatusOr<SimulatedWorld> world = SimulateOpen(SmallFloor(2));
  ASSERT_THAT(world, IsOk());
  world->groups[0].modes[0] += Eigen::Vector2d(3.0, 0.0);
  world->groups[0].modes[1] += Eigen::Vector2d(3.0, 0.0);
  EnginesResult result;
  ASSERT_THAT(CompareEngines("wrong", 2, *world, &result), IsOk());
  const EnginesRow& row = result.sites[0];
  for (const EngineScore* score : {&row.graph, &row.tree}) {
    EXPECT_GE(score->spurious, 1);
    EXPECT_GE(score->missing, 1);
    EXPECT_LT(score->groups_right, row.difference.groups);
  }
}

TEST(Engines, SitesAddUp) {
  EnginesRow a;
  a.runs = 3;
  a.difference.groups = 20;
  a.graph.squared_m2 = 0.5;
  a.tree.left_out = 1;
  EnginesRow sum = a;
  sum.Add(a);
  EXPECT_EQ(sum.runs, 6);
  EXPECT_EQ(sum.difference.groups, 40);
  EXPECT_EQ(sum.graph.squared_m2, 1.0);
  EXPECT_EQ(sum.tree.left_out, 2);
}

TEST(Engines, KindsOfSitesAreDrawn) {
  for (const std::string& kind : EngineSiteKinds()) {
    const StatusOr<SimulatedWorld> world = DrawEngineSite(kind, 1);
    ASSERT_THAT(world, IsOk()) << kind;
    EXPECT_GE(world->runs.size(), 3u);
  }
  EXPECT_EQ(DrawEngineSite("moon", 1).status().code(), StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace shiftmap

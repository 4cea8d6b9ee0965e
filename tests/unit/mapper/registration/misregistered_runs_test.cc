// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/misregistered_runs.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/modes/mode_refinement.h"
#include "mapper/registration/place_run_maps.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

class MisregisteredRuns : public ::testing::Test {
 protected:
  // The runs of a world, solved together.
  BuildState Solved(const SimulatedWorld& world) {
    std::vector<RunMap> run_maps;
    for (const SimulatedRun& run : world.runs) {
      runs_.push_back(testing::Arrange(world, run.run));
      run_maps.push_back(
          MakeRunMap(options_, MapSingleRun(runs_.back(), world.groups.size(), options_)).value());
    }
    BuildState build = StartBuild(world.groups.size(), options_.calibration.sensor);
    std::vector<RejectedRun> rejected;
    PlaceRunMaps(options_, std::nullopt, std::move(run_maps), &build, &rejected);
    GraphSolver solver;
    RefineModes(options_, &build, &solver);
    return build;
  }

  static OpenWorldOptions World(std::uint64_t seed) {
    OpenWorldOptions world = testing::SmallWorld(seed);
    world.groups = 30;
    world.size_m = 30.0;
    world.duration_s = 300.0;
    return world;
  }

  // Of a build in which a run lays a second map from its middle on.
  void ExpectOptionsDecide(const BuildState& build) {
    const auto put_back = [&](const RelocationOptions& relocation) {
      MapperOptions options = options_;
      options.relocation = relocation;
      BuildState moved = build;
      const int count = RelocateMisregisteredRuns(options, &moved);
      return std::pair(count, moved.runs[1].poses.back().x());
    };
    EXPECT_EQ(put_back({.min_visits = 1000}).first, 0);
    EXPECT_EQ(put_back({.same_place_m = 1e-6}).first, 0);
    EXPECT_NE(put_back({.part_visits = 1e4}), put_back({}));  // All of it is one part.
  }

  MapperOptions options_;
  std::deque<MappingRun> runs_;
};

// Moves a run from a key frame on, and all that it sees from there.
void LaySecondMap(FrameIndex from, const Se2& T_there_here, BuildRun* run, BuildState* build) {
  std::map<BuildModeRef, GroupModeIndex> become;
  for (FrameIndex i = from; i < run->poses.end_index(); ++i) {
    run->poses[i] = T_there_here * run->poses[i];
  }
  for (const VisitIndex v : run->assignment.indices()) {
    const MappingVisit& visit = run->data->visits[v];
    OptionalMode& assignment = run->assignment[v];
    if (visit.begin < run->data->frames[from].stamp || !assignment) continue;
    const auto [entry, added] = become.try_emplace({visit.group, *assignment});
    if (added) {
      const Eigen::Vector2d& here = build->modes[visit.group][*assignment].p_map_landmark;
      entry->second = AddMode(visit.group, {T_there_here * here, kAbsent}, build);
    }
    assignment = entry->second;
  }
}

TEST_F(MisregisteredRuns, ArePutBack) {
  OpenWorldOptions world = World(3);
  world.modes_per_group = 1;
  BuildState build = Solved(testing::Simulate(world));
  ASSERT_EQ(build.runs.size(), 3u);
  const BuildRun before = build.runs[1];
  const std::size_t modes = testing::CountModes(build);
  for (const std::size_t share : {0u, 2u}) {
    const FrameIndex from(before.poses.size() * share / 4);
    LaySecondMap(from, Se2(12.0, 5.0, 0.4), &build.runs[1], &build);
    ASSERT_GT(testing::CountModes(build), modes + 5);
    if (share == 2) ExpectOptionsDecide(build);
    EXPECT_EQ(RelocateMisregisteredRuns(options_, &build), 1);
    GraphSolver solver;
    AlternateModes(options_, &build, &solver);
    EXPECT_EQ(testing::CountModes(build), modes);
    for (const FrameIndex i : before.poses.indices()) {
      const Se2 error = before.poses[i].Inverse() * build.runs[1].poses[i];
      EXPECT_LT(error.translation().norm(), 0.2);
    }
  }
}

// No part of it is of before and after at once.
TEST_F(MisregisteredRuns, OneWhoseVehicleWasCarriedIsPutBack) {
  OpenWorldOptions options = World(1);
  options.modes_per_group = 1;
  SimulatedWorld world = testing::Simulate(options);
  const Stamp begin = world.runs[1].truth.front().stamp;
  world.runs[1] = testing::CarriedMeanwhile(
      world.runs[1], begin + std::chrono::seconds(130), begin + std::chrono::seconds(170));
  BuildState build = Solved(world);
  ASSERT_EQ(build.runs.size(), 3u);
  const BuildRun before = build.runs[1];
  ASSERT_EQ(BrokenMotions(before.motions).size(), 1u);
  const std::size_t modes = testing::CountModes(build);
  LaySecondMap(0, Se2(12.0, 5.0, 0.4), &build.runs[1], &build);
  EXPECT_EQ(RelocateMisregisteredRuns(options_, &build), 1);
  for (const FrameIndex i : before.poses.indices()) {
    const Se2 error = before.poses[i].Inverse() * build.runs[1].poses[i];
    EXPECT_LT(error.translation().norm(), 0.5) << i.value();
  }
  GraphSolver solver;
  AlternateModes(options_, &build, &solver);
  EXPECT_EQ(testing::CountModes(build), modes);
}

TEST_F(MisregisteredRuns, LandmarksThatMovedAreNone) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    runs_.clear();
    BuildState build = Solved(testing::Simulate(World(seed)));
    const std::size_t modes = testing::CountModes(build);
    EXPECT_EQ(RelocateMisregisteredRuns(options_, &build), 0) << seed;
    EXPECT_EQ(testing::CountModes(build), modes);
  }
}

}  // namespace
}  // namespace shiftmap

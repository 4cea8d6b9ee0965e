// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/stray_runs.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/modes/mode_refinement.h"
#include "mapper/submaps/place_submaps.h"
#include "mapper/submaps/single_run.h"
#include "mapper/submaps/submap.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

class StrayRuns : public ::testing::Test {
 protected:
  // The runs of a world, solved together.
  MapProblem Solved(const SimulatedWorld& world) {
    std::vector<Submap> submaps;
    for (const SimulatedRun& run : world.runs) {
      runs_.push_back(testing::Arrange(world, run.run));
      submaps.push_back(
          MakeSubmap(options_, MapSingleRun(runs_.back(), world.groups.size(), options_)).value());
    }
    MapProblem problem = StartProblem(world.groups.size(), options_.calibration.sensor);
    std::vector<RejectedRun> rejected;
    PlaceSubmaps(options_, std::nullopt, std::move(submaps), &problem, &rejected);
    GraphSolver solver;
    RefineModes(options_, &problem, &solver);
    return problem;
  }

  static OpenWorldOptions World(std::uint64_t seed) {
    OpenWorldOptions world = testing::SmallWorld(seed);
    world.groups = 30;
    world.size_m = 30.0;
    world.duration_s = 300.0;
    return world;
  }

  MapperOptions options_;
  std::deque<MappingRun> runs_;
};

// Moves a run from a key frame on, and all that it sees from there.
void LaySecondMap(std::size_t from, const Se2& T_there_here, BuildRun* run, MapProblem* problem) {
  std::map<std::pair<int, int>, int> become;
  for (std::size_t i = from; i < run->poses.size(); ++i) {
    run->poses[i] = T_there_here * run->poses[i];
  }
  for (std::size_t v = 0; v < run->assignment.size(); ++v) {
    const MappingVisit& visit = run->data->visits[v];
    int& assignment = run->assignment[v];
    if (visit.begin < run->data->frames[from].stamp || assignment == kUnassigned) continue;
    const auto [entry, added] = become.try_emplace({visit.group, assignment}, 0);
    if (added) {
      const Eigen::Vector2d& here =
          problem
              ->modes[static_cast<std::size_t>(visit.group)][static_cast<std::size_t>(assignment)]
              .p_map_landmark;
      entry->second = AddMode(visit.group, {T_there_here * here, kAbsent, false}, problem);
    }
    assignment = entry->second;
  }
}

TEST_F(StrayRuns, ArePutBack) {
  OpenWorldOptions world = World(3);
  world.modes_per_group = 1;
  MapProblem problem = Solved(testing::Simulate(world));
  ASSERT_EQ(problem.runs.size(), 3u);
  const BuildRun before = problem.runs[1];
  const std::size_t modes = testing::CountModes(problem);
  for (const std::size_t share : {0u, 2u}) {
    const std::size_t from = before.poses.size() * share / 4;
    LaySecondMap(from, Se2(12.0, 5.0, 0.4), &problem.runs[1], &problem);
    ASSERT_GT(testing::CountModes(problem), modes + 5);
    EXPECT_EQ(PutBackStrayRuns(options_, &problem), 1);
    GraphSolver solver;
    AlternateModes(options_, &problem, &solver);
    EXPECT_EQ(testing::CountModes(problem), modes);
    for (std::size_t i = 0; i < before.poses.size(); ++i) {
      const Se2 error = before.poses[i].Inverse() * problem.runs[1].poses[i];
      EXPECT_LT(error.translation().norm(), 0.2);
    }
  }
}

TEST_F(StrayRuns, LandmarksThatMovedAreNone) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    runs_.clear();
    MapProblem problem = Solved(testing::Simulate(World(seed)));
    const std::size_t modes = testing::CountModes(problem);
    EXPECT_EQ(PutBackStrayRuns(options_, &problem), 0) << seed;
    EXPECT_EQ(testing::CountModes(problem), modes);
  }
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/mode_merging.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "mapper/submaps/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

TEST(MergeMemory, MergesModesThatAreOnePlace) {
  const SimulatedWorld world = testing::StaticWorld(1);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const MapperOptions options;
  MapProblem problem = MapSingleRun(run, world.groups.size(), options);
  const std::vector<std::vector<VisitRef>> visits = VisitsByGroup(problem);
  const auto busiest =
      std::max_element(visits.begin(), visits.end(), [](const auto& a, const auto& b) {
        return a.size() < b.size();
      });
  ASSERT_GE(busiest->size(), 2u);
  const auto group = static_cast<std::size_t>(busiest - visits.begin());
  ASSERT_EQ(problem.modes[group].size(), 1u);
  const std::size_t before = testing::CountModes(problem);
  problem.modes[group].push_back(problem.modes[group].front());
  problem.runs[0].assignment[static_cast<std::size_t>(busiest->back().visit)] = 1;
  GraphSolver solver;
  const Graph graph = SolveContinuous(options, &problem, &solver);
  const auto differences = ModeDifferences::Of(graph, &solver);
  ASSERT_TRUE(differences);
  const std::vector<ModeMerge> merges = FindMerges(options.modes, *differences, problem);
  EXPECT_EQ(merges.size(), 1u);
  MergeMemory(problem).Merge(merges, &problem);
  EXPECT_EQ(testing::CountModes(problem), before);
  for (const VisitRef& ref : *busiest) EXPECT_EQ(AssignmentOf(problem, ref), 0);
}

TEST(DropUnusedModes, ModesOfThePriorMapStayThoughNothingHoldsThere) {
  const SimulatedWorld world = testing::StaticWorld(1);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  MapProblem problem = MapSingleRun(run, world.groups.size(), {});
  const std::size_t before = testing::CountModes(problem);
  problem.modes[0].push_back({Eigen::Vector2d(50.0, 50.0), ModeNumber(7)});
  problem.modes[1].push_back({Eigen::Vector2d(50.0, 50.0), kAbsent});
  DropUnusedModes(&problem);
  EXPECT_EQ(testing::CountModes(problem), before + 1);
  EXPECT_EQ(problem.modes[0].back().number, ModeNumber(7));
}

// A landmark that is only ever misread holds at the mode of one reading, which explains none of the
// others.
TEST(DropFaintModes, CountsWhatAModeExplains) {
  const SimulatedWorld world = testing::StaticWorld(1);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const MapperOptions options;
  MapProblem problem = MapSingleRun(run, world.groups.size(), options);
  DropFaintModes(options.modes, &problem);
  const std::size_t before = testing::CountModes(problem);
  const auto group = static_cast<std::size_t>(run.visits.front().group);
  ASSERT_EQ(problem.modes[group].size(), 1u);
  problem.modes[group].front().p_map_landmark.x() += 20.0;
  EXPECT_EQ(DropFaintModes(options.modes, &problem), 1);
  EXPECT_EQ(testing::CountModes(problem), before - 1);
  EXPECT_EQ(problem.runs[0].assignment.front(), kUnassigned);
  EXPECT_EQ(DropFaintModes(options.modes, &problem), 0);
}

TEST(DropUnusedModes, KeepsThePriorsIndicesRight) {
  MapProblem problem;
  problem.modes = {{{Eigen::Vector2d::Zero(), kAbsent}, {Eigen::Vector2d::Ones(), ModeNumber(1)}},
                   {{Eigen::Vector2d::Ones(), ModeNumber(1)}}};
  problem.priors.emplace_back().modes = {1};
  problem.priors.emplace_back().modes = {2};
  DropUnusedModes(&problem);
  EXPECT_EQ(problem.priors[0].modes, std::vector<int>{0});
  EXPECT_EQ(problem.priors[1].modes, std::vector<int>{1});
  EXPECT_EQ(testing::CountModes(problem), 2u);
}

TEST(MergeMemory, MergesAgainWhereTheGroupIsAsItWas) {
  MappingRun run;
  run.visits.resize(2);
  MapProblem problem;
  problem.modes = {{{Eigen::Vector2d::Zero(), kAbsent}, {Eigen::Vector2d::Ones(), kAbsent}}};
  problem.runs.resize(1);
  problem.runs[0].data = &run;
  problem.runs[0].assignment = {0, 1};
  const MapProblem two_modes = problem;

  MergeMemory memory(problem);
  memory.Merge({{0, 0, 1}}, &problem);
  EXPECT_EQ(testing::CountModes(problem), 1u);
  EXPECT_EQ(problem.runs[0].assignment, (std::vector<int>{0, 0}));

  MapProblem again = two_modes;
  memory.MergeAgain(&again);
  EXPECT_EQ(again.runs[0].assignment, problem.runs[0].assignment);

  MapProblem other = two_modes;
  other.runs[0].assignment = {1, 0};
  memory.MergeAgain(&other);
  EXPECT_EQ(other.runs[0].assignment, (std::vector<int>{1, 0}));
}

}  // namespace
}  // namespace shiftmap

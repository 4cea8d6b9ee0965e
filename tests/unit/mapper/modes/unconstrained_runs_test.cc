// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/unconstrained_runs.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapper/covariance/mode_covariance.h"
#include "mapper/registration/place_run_maps.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// Runs that each have one visit at the first mode of each of some groups.
class UnconstrainedRuns : public ::testing::Test {
 protected:
  UnconstrainedRuns() { problem_.modes.resize(kGroups); }

  void Add(const std::string& name, const std::vector<GroupIndex>& groups) {
    MappingRun& data = *runs_.emplace_back(std::make_unique<MappingRun>());
    data.name = name;
    BuildRun run;
    run.data = &data;
    for (const GroupIndex group : groups) {
      data.visits.push_back({group, {}, {}, {}});
      run.assignment.push_back(GroupModeIndex(0));
      auto& modes = problem_.modes[group];
      if (modes.empty()) modes.push_back({});
    }
    problem_.runs.push_back(std::move(run));
  }

  std::vector<std::string> Left() const {
    std::vector<std::string> names;
    for (const BuildRun& run : problem_.runs) names.push_back(run.data->name);
    return names;
  }

  static constexpr std::size_t kGroups = 10;
  BuildState problem_;
  std::vector<std::unique_ptr<MappingRun>> runs_;
};

using Names = std::vector<std::string>;

TEST_F(UnconstrainedRuns, AreThoseOfFewerThanTwoModesOfOthers) {
  Add("a", {0, 1, 2});
  Add("by-one", {2, 7, 8});
  Add("b", {1, 2, 3});
  Add("by-two-runs", {0, 3, 9});
  Add("apart", {5, 6});
  EXPECT_EQ(RemoveUnconstrainedRuns(&problem_), 2);
  EXPECT_EQ(Left(), (Names{"a", "b", "by-two-runs"}));
  ASSERT_EQ(problem_.left_out.size(), 2u);
  EXPECT_EQ(problem_.left_out[0].name, "by-one");
  EXPECT_EQ(problem_.left_out[1].name, "apart");
  EXPECT_EQ(problem_.left_out[1].reason, kUnconstrainedReason);
  for (const GroupIndex group : problem_.modes.indices()) {
    const bool gone = group >= 5 && group <= 8;
    EXPECT_EQ(problem_.modes[group].size(), gone || group == 4 ? 0u : 1u);
  }
  EXPECT_EQ(RemoveUnconstrainedRuns(&problem_), 0);
}

TEST_F(UnconstrainedRuns, TheMostThatAreTiedStay) {
  Add("stranger", {0, 1, 2, 3});
  Add("a", {3, 4, 5});
  Add("b", {4, 5, 6});
  EXPECT_EQ(RemoveUnconstrainedRuns(&problem_), 1);
  EXPECT_EQ(Left(), (Names{"a", "b"}));
}

TEST_F(UnconstrainedRuns, VisitsWithoutModeTieNothing) {
  Add("a", {0, 1, 2});
  Add("b", {0, 1, 2});
  problem_.runs[1].assignment = {GroupModeIndex(0), kUnassigned, kUnassigned};
  EXPECT_EQ(RemoveUnconstrainedRuns(&problem_), 1);
  EXPECT_EQ(Left(), Names{"a"});
}

TEST_F(UnconstrainedRuns, ARunWithoutModesIsNoMap) {
  Add("outliers", {0});
  problem_.runs[0].assignment = {kUnassigned};
  Add("a", {1, 2});
  EXPECT_EQ(RemoveUnconstrainedRuns(&problem_), 1);
  EXPECT_EQ(Left(), Names{"a"});
}

TEST_F(UnconstrainedRuns, RunsOfOutliersAreNamed) {
  Add("outliers", {0, 1});
  problem_.runs[0].assignment = {kUnassigned, kUnassigned};
  Add("a", {1});
  EXPECT_EQ(RemoveRunsOfOutliers(&problem_), 1);
  EXPECT_EQ(Left(), Names{"a"});
  ASSERT_EQ(problem_.left_out.size(), 1u);
  EXPECT_EQ(problem_.left_out[0].name, "outliers");
  EXPECT_EQ(problem_.left_out[0].reason, kOutliersReason);
  EXPECT_TRUE(problem_.modes[0].empty());
  EXPECT_EQ(RemoveRunsOfOutliers(&problem_), 0);
}

TEST_F(UnconstrainedRuns, OneRunByItselfIsTied) {
  Add("a", {0});
  EXPECT_EQ(RemoveUnconstrainedRuns(&problem_), 0);
}

TEST_F(UnconstrainedRuns, WithAPriorMapItIsThatWhichTies) {
  Add("a", {0, 1});
  Add("b", {1, 2});
  Add("c", {5, 6, 7});
  Add("d", {5, 6, 7});
  for (GroupIndex group; group <= 2; ++group) problem_.modes[group][0].number = ModeNumber(1);
  problem_.priors.emplace_back().modes = {0, 1};
  problem_.priors.emplace_back().modes = {2};
  EXPECT_EQ(RemoveUnconstrainedRuns(&problem_), 2);
  EXPECT_EQ(Left(), (Names{"a", "b"}));
  problem_.runs.clear();
  Add("e", {7, 8});
  EXPECT_EQ(RemoveUnconstrainedRuns(&problem_), 1);
  EXPECT_TRUE(problem_.runs.empty());
}

TEST(UndeterminedRuns, AreThoseWhoseValuesAreBeyondAllBounds) {
  const MapperOptions options;
  OpenWorldOptions small = testing::SmallWorld(3);
  small.runs = 3;
  const SimulatedWorld world = testing::Simulate(small);
  std::deque<MappingRun> runs;
  std::vector<RunMap> run_maps;
  for (const SimulatedRun& run : world.runs) {
    runs.push_back(testing::Arrange(world, run.run));
    runs.back().name = fmt::format("run-{}", runs.size());
    run_maps.push_back(
        MakeRunMap(options, MapSingleRun(runs.back(), world.groups.size(), options)).value());
  }
  BuildState build = StartBuild(world.groups.size(), options.calibration.sensor);
  std::vector<RejectedRun> rejected;
  PlaceRunMaps(options, std::nullopt, std::move(run_maps), &build, &rejected);
  ASSERT_EQ(build.runs.size(), 3u);

  EXPECT_EQ(RemoveUndeterminedRuns(options, &build), 0);
  EXPECT_EQ(build.runs.size(), 3u);
  const std::string odd = build.runs[1].data->name;
  for (Se2& pose : build.runs[1].poses) pose = Se2(1e300, -1e300, 0.5) * pose;
  ASSERT_EQ(LinearizeForMap(MakeGraph(options, &build)), nullptr);
  EXPECT_EQ(RemoveUndeterminedRuns(options, &build), 1);
  EXPECT_EQ(build.runs.size(), 2u);
  ASSERT_EQ(build.left_out.size(), 1u);
  EXPECT_EQ(build.left_out[0].name, odd);
  EXPECT_EQ(build.left_out[0].reason, kUndeterminedReason);
  EXPECT_NE(LinearizeForMap(MakeGraph(options, &build)), nullptr);
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/mode_merging.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "mapper/run_maps/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

TEST(MergeMemory, MergesModesThatAreOnePlace) {
  const SimulatedWorld world = testing::StaticWorld(1);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const MapperOptions options;
  BuildState build = MapSingleRun(run, world.groups.size(), options);
  const auto visits = VisitsByGroup(build);
  const auto busiest =
      std::max_element(visits.begin(), visits.end(), [](const auto& a, const auto& b) {
        return a.size() < b.size();
      });
  ASSERT_GE(busiest->size(), 2u);
  const GroupIndex group(busiest - visits.begin());
  ASSERT_EQ(build.modes[group].size(), 1u);
  const std::size_t before = testing::CountModes(build);
  build.modes[group].push_back(build.modes[group].front());
  AssignmentOf(&build, busiest->back()) = GroupModeIndex(1);
  GraphSolver solver;
  const Graph graph = SolveContinuous(options, &build, &solver);
  const auto differences = ModeDifferences::Of(graph, &solver);
  ASSERT_TRUE(differences);
  const std::vector<ModeMerge> merges = FindMerges(options.modes, *differences, build);
  EXPECT_EQ(merges.size(), 1u);
  ModeOptions sure = options.modes;
  sure.max_merge_sd_m = 1e-3;  // Nothing is known that well.
  EXPECT_TRUE(FindMerges(sure, *differences, build).empty());

  // Displaced from the prior map's mode, and merged only where it may have been between two.
  BuildState on_prior = build;
  GroupModes& modes = on_prior.modes[group];
  const Eigen::Vector2d difference = modes[1].p_map_landmark - modes[0].p_map_landmark;
  modes[0].number = ModeNumber(1);
  modes[1].displaced_to = modes[1].p_map_landmark + 1.1 * difference;
  EXPECT_TRUE(FindMerges(options.modes, *differences, on_prior).empty());
  modes.push_back({Eigen::Vector2d(50.0, 50.0), ModeNumber(2)});
  EXPECT_EQ(FindMerges(options.modes, *differences, on_prior).size(), 1u);
  modes[1].displaced_to = modes[1].p_map_landmark + 0.9 * difference;
  EXPECT_TRUE(FindMerges(options.modes, *differences, on_prior).empty());

  MergeMemory(build).Merge(merges, &build);
  EXPECT_EQ(testing::CountModes(build), before);
  for (const VisitRef& ref : *busiest) EXPECT_EQ(AssignmentOf(build, ref), GroupModeIndex(0));
}

// A landmark with two modes: each has a standard deviation of 0.4 m, their difference a smaller
// one.
MapContent OneLandmark(const Eigen::Vector2d& apart, double sd_difference_m) {
  MapContent content;
  LandmarkGroup group;
  group.signature = Signature("A");
  const Eigen::Matrix2d known = 0.16 * Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d better = 0.15 * Eigen::Matrix2d::Identity();
  group.modes = {{ModeNumber(2), {1.0, 2.0}, known, {}}, {ModeNumber(5), {1.0, 2.0}, better, {}}};
  group.modes[1].p_map_landmark += apart;
  group.chain = ModeChain::Uniform(2, 1e-5);
  group.probabilities = Eigen::Vector3d(0.1, 0.3, 0.6);
  content.groups = {group};
  const double cross = 0.5 * (0.31 - sd_difference_m * sd_difference_m);
  content.covariance =
      JointCovariance({known, better}, {{0, 1, cross * Eigen::Matrix2d::Identity()}});
  content.stamp = StampFromSeconds(1.7e9);
  for (Mode& mode : content.groups[0].modes) mode.last_seen = content.stamp;
  return content;
}

TEST(MergeModesOfPrior, TheBetterKnownOfTwoAtOnePlaceStandsForBoth) {
  MapContent content = OneLandmark({0.03, 0.0}, 0.02);
  ASSERT_TRUE(ValidateMapContent(content).ok());
  EXPECT_EQ(MergeModesOfPrior({}, {}, &content), 1);
  EXPECT_TRUE(ValidateMapContent(content).ok());
  const LandmarkGroup& group = content.groups[0];
  ASSERT_EQ(group.modes.size(), 1U);
  EXPECT_EQ(group.modes[0].number, ModeNumber(5));
  ASSERT_EQ(group.merged.size(), 1U);
  EXPECT_EQ(group.merged[0].number, ModeNumber(2));
  EXPECT_EQ(group.merged[0].into, ModeNumber(5));
  EXPECT_NEAR(group.probabilities(1), 0.9, 1e-12);
  EXPECT_EQ(MergeModesOfPrior({}, {}, &content), 0);
}

TEST(MergeModesOfPrior, WhatMayBeTwoPlacesStays) {
  MapContent apart = OneLandmark({0.1, 0.0}, 0.05);
  EXPECT_EQ(MergeModesOfPrior({}, {}, &apart), 0);
  MapContent vague = OneLandmark({0.03, 0.0}, 0.1);
  EXPECT_EQ(MergeModesOfPrior({}, {}, &vague), 0);
  MapContent excepted = OneLandmark({0.03, 0.0}, 0.02);
  EXPECT_EQ(MergeModesOfPrior({}, {Signature("A")}, &excepted), 0);
}

// Both positions share most of their errors: a difference of 6 cm is significant.
TEST(MergeModesOfPrior, WhatTheMapTellsApartStays) {
  MapContent content = OneLandmark({0.06, 0.0}, 0.007);
  EXPECT_EQ(MergeModesOfPrior({}, {}, &content), 0);
}

TEST(MergeModesOfPrior, AModeThatNoRunHasMetStays) {
  MapContent content = OneLandmark({0.03, 0.0}, 0.02);
  content.groups[0].modes[0].last_seen = Stamp();
  EXPECT_EQ(MergeModesOfPrior({}, {}, &content), 0);
}

TEST(DropUnusedModes, ModesOfThePriorMapStayThoughNothingHoldsThere) {
  const SimulatedWorld world = testing::StaticWorld(1);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  BuildState build = MapSingleRun(run, world.groups.size(), {});
  const std::size_t before = testing::CountModes(build);
  build.modes[0].push_back({Eigen::Vector2d(50.0, 50.0), ModeNumber(7)});
  build.modes[1].push_back({Eigen::Vector2d(50.0, 50.0), kAbsent});
  DropUnusedModes(&build);
  EXPECT_EQ(testing::CountModes(build), before + 1);
  EXPECT_EQ(build.modes[0].back().number, ModeNumber(7));
}

// A landmark that is only ever misread holds at the mode of one reading, which explains none of the
// others.
TEST(DropUnsupportedModes, CountsWhatAModeExplains) {
  const SimulatedWorld world = testing::StaticWorld(1);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const MapperOptions options;
  BuildState build = MapSingleRun(run, world.groups.size(), options);
  DropUnsupportedModes(options.modes, &build);
  const std::size_t before = testing::CountModes(build);
  const GroupIndex group = run.visits.front().group;
  ASSERT_EQ(build.modes[group].size(), 1u);
  build.modes[group].front().p_map_landmark.x() += 20.0;
  EXPECT_EQ(DropUnsupportedModes(options.modes, &build), 1);
  EXPECT_EQ(testing::CountModes(build), before - 1);
  EXPECT_EQ(build.runs[0].assignment.front(), kUnassigned);
  EXPECT_EQ(DropUnsupportedModes(options.modes, &build), 0);
}

TEST(DropUnusedModes, KeepsThePriorsIndicesRight) {
  BuildState build;
  build.modes = {{{Eigen::Vector2d::Zero(), kAbsent}, {Eigen::Vector2d::Ones(), ModeNumber(1)}},
                 {{Eigen::Vector2d::Ones(), ModeNumber(1)}}};
  build.priors.emplace_back().modes = {1};
  build.priors.emplace_back().modes = {2};
  DropUnusedModes(&build);
  EXPECT_EQ(build.priors[0].modes, std::vector<ModeIndex>{0});
  EXPECT_EQ(build.priors[1].modes, std::vector<ModeIndex>{1});
  EXPECT_EQ(testing::CountModes(build), 2u);
}

TEST(MergeMemory, MergesAgainWhereTheGroupIsAsItWas) {
  MappingRun run;
  run.visits.resize(2);
  BuildState build;
  build.modes = {{{Eigen::Vector2d::Zero(), kAbsent}, {Eigen::Vector2d::Ones(), kAbsent}}};
  build.runs.resize(1);
  build.runs[0].data = &run;
  const GroupModeIndex first = 0;
  const GroupModeIndex second = 1;
  build.runs[0].assignment = {first, second};
  const BuildState two_modes = build;

  MergeMemory memory(build);
  memory.Merge({{0, 0, 1}}, &build);
  EXPECT_EQ(testing::CountModes(build), 1u);
  EXPECT_EQ(build.runs[0].assignment, (std::vector<OptionalMode>{first, first}));

  BuildState again = two_modes;
  memory.MergeAgain(&again);
  EXPECT_EQ(again.runs[0].assignment, build.runs[0].assignment);

  BuildState other = two_modes;
  other.runs[0].assignment = {second, first};
  memory.MergeAgain(&other);
  EXPECT_EQ(other.runs[0].assignment, (std::vector<OptionalMode>{second, first}));
}

}  // namespace
}  // namespace shiftmap

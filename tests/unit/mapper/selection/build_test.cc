// SPDX-License-Identifier: Apache-2.0
//
// Maps built with every selector, end to end on simulated worlds.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "mapper/mapper.h"
#include "mapper/modes/mode_refinement.h"
#include "mapper/modes/selection_summary.h"
#include "mapper/run_maps/single_run.h"
#include "proto/core/check.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::MatchedMode;

MapperOptions With(SelectorKind kind) {
  MapperOptions options;
  options.modes.selector.kind = kind;
  return options;
}

MapperResult Build(const SimulatedWorld& world,
                   SelectorKind kind,
                   const std::optional<MapContent>& prior = std::nullopt) {
  StatusOr<MapperResult> result = BuildMap(testing::Inputs(world), prior, With(kind));
  SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
  return *std::move(result);
}

// Two runs a day apart; most landmarks stay, some are elsewhere on the second day.
SimulatedWorld TwoDays(std::uint64_t seed) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.runs = 2;
  options.duration_s = 100.0;
  return testing::Simulate(options);
}

std::size_t CountModes(const MapContent& content) {
  std::size_t count = 0;
  for (const LandmarkGroup& group : content.groups) count += group.modes.size();
  return count;
}

class BuildWithSelector : public ::testing::TestWithParam<SelectorKind> {};

TEST_P(BuildWithSelector, MapsAWorldWhoseLandmarksMove) {
  const SimulatedWorld world = TwoDays(2);
  const MapperResult result = Build(world, GetParam());
  EXPECT_TRUE(result.rejected.empty());
  EXPECT_THAT(ValidateMapContent(result.content), IsOk());
  EXPECT_GT(result.selection.visits, 30);
  EXPECT_LE(result.selection.log_joint, result.selection.best_log_joint + 1e-9);

  const auto sure = testing::VisitedModes(world, 6);
  if (GetParam() == SelectorKind::kNoHypotheses) {
    for (const LandmarkGroup& group : result.content.groups) {
      EXPECT_EQ(group.modes.size(), 1u) << group.signature.text();
    }
    return;
  }
  // Every place that was seen often enough is a mode, where it is.
  for (std::size_t g = 0; g < world.groups.size(); ++g) {
    std::set<ModeNumber> mapped;
    for (const MatchedMode& match : testing::MatchModes(result.content, world)) {
      if (result.content.groups[match.group].signature != world.groups[g].signature) continue;
      mapped.insert(match.truth);
      EXPECT_LT(match.error.norm(), 0.35) << world.groups[g].signature.text();
    }
    EXPECT_TRUE(std::includes(mapped.begin(), mapped.end(), sure[g].begin(), sure[g].end()))
        << world.groups[g].signature.text();
  }
}

TEST_P(BuildWithSelector, TheSameInputGivesTheSameMap) {
  const SimulatedWorld world = TwoDays(3);
  EXPECT_EQ(ContentHash(Build(world, GetParam()).content),
            ContentHash(Build(world, GetParam()).content));
}

TEST_P(BuildWithSelector, ContinuesAPriorMap) {
  OpenWorldOptions options = testing::SmallWorld(5);
  options.duration_s = 100.0;
  options.runs = 2;
  const SimulatedWorld world = testing::Simulate(options);
  const std::vector<MapperInput> inputs = testing::Inputs(world);
  const StatusOr<MapperResult> first =
      BuildMap({inputs[0]}, std::nullopt, With(SelectorKind::kViterbi));
  ASSERT_THAT(first, IsOk());
  const StatusOr<MapperResult> second = BuildMap({inputs[1]}, first->content, With(GetParam()));
  ASSERT_THAT(second, IsOk());
  // Modes of the prior stay, whatever the selector makes of them.
  EXPECT_GE(CountModes(second->content), CountModes(first->content));
  EXPECT_EQ(CountModes(second->content),
            CountModes(first->content) + static_cast<std::size_t>(second->modes_created));
}

INSTANTIATE_TEST_SUITE_P(AllSelectors,
                         BuildWithSelector,
                         ::testing::ValuesIn(AllSelectors()),
                         [](const auto& instance) {
                           std::string name = SelectorName(instance.param);
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

TEST(BuildMapSelection, ViterbiIsTheDefaultAndReachesTheBestJoint) {
  const SimulatedWorld world = TwoDays(1);
  const MapperResult result = Build(world, SelectorKind::kViterbi);
  EXPECT_DOUBLE_EQ(result.selection.log_joint, result.selection.best_log_joint);
  EXPECT_LT(result.selection.uncertain_visits, result.selection.visits / 4);
  const StatusOr<MapperResult> by_default =
      BuildMap(testing::Inputs(world), std::nullopt, MapperOptions());
  ASSERT_THAT(by_default, IsOk());
  EXPECT_EQ(ContentHash(by_default->content), ContentHash(result.content));
}

TEST(BuildMapSelection, OnePositionPerLandmarkCostsAccuracyWhereLandmarksMove) {
  double viterbi = 0.0;
  double static_map = 0.0;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SimulatedWorld world = TwoDays(seed);
    const auto rmse = [&](SelectorKind kind) {
      const MapperResult result = Build(world, kind);
      double sum = 0.0;
      for (std::size_t r = 0; r < result.runs.size(); ++r) {
        const MappingRun run = testing::Arrange(world, world.runs[r].run);
        std::vector<Se2> poses;
        for (const StampedPose& pose : result.runs[r].trajectory) {
          poses.push_back(pose.T_map_vehicle);
        }
        sum += testing::AlignedRmse(poses, testing::TruePoses(world.runs[r], run));
      }
      return sum / static_cast<double>(result.runs.size());
    };
    viterbi += rmse(SelectorKind::kViterbi) / 3.0;
    static_map += rmse(SelectorKind::kNoHypotheses) / 3.0;
  }
  RecordProperty("rmse_viterbi_m", std::to_string(viterbi));
  RecordProperty("rmse_nohyp_m", std::to_string(static_map));
  EXPECT_LT(viterbi, static_map);
}

TEST(BuildMapSelection, OptionsOutOfRangeAreAnError) {
  MapperOptions options;
  options.modes.selector.mcts.iterations = 0;
  EXPECT_THAT(BuildMap({}, std::nullopt, options),
              testing::StatusIs(StatusCode::kInvalidArgument, "mcts iterations: 0"));
}

// A group's chain has a step per visit and the states absent and its modes.
TEST(SummarizeSelection, SeesAWrongAssignment) {
  const SimulatedWorld world = TwoDays(4);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const MapperOptions options;
  BuildState build = MapSingleRun(run, world.groups.size(), options);
  const SelectionSummary before = SummarizeSelection(options.modes, build);
  EXPECT_EQ(before.visits, static_cast<int>(run.visits.size()));
  EXPECT_NEAR(before.log_joint, before.best_log_joint, 1e-9);
  for (OptionalMode& assignment : build.runs[0].assignment) assignment = kUnassigned;
  const SelectionSummary after = SummarizeSelection(options.modes, build);
  EXPECT_LT(after.log_joint, after.best_log_joint);
  EXPECT_NEAR(after.best_log_joint, before.best_log_joint, 1e-9);
  EXPECT_GT(after.uncertain_visits, before.uncertain_visits);
}

}  // namespace
}  // namespace shiftmap

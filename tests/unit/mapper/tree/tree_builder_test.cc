// SPDX-License-Identifier: Apache-2.0
#include "mapper/tree/tree_builder.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/status_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

using testing::Inputs;
using testing::IsOk;
using testing::MatchedMode;
using testing::MatchModes;
using testing::Simulate;
using testing::SmallWorld;
using testing::StatusIs;
using testing::VisitedModes;

MapperOptions Options() {
  MapperOptions options;
  options.sd_range_scale = 0.0;
  return options;
}

TEST(TreeBuilder, FindsTheModesThatWereVisited) {
  int wanted = 0;
  int found = 0;
  int spurious = 0;
  double squared = 0.0;
  for (const std::uint64_t seed : {1, 2, 3, 4}) {
    const SimulatedWorld world = Simulate(SmallWorld(seed));
    const auto result = BuildMapByTree(Inputs(world), std::nullopt, Options(), {});
    ASSERT_THAT(result, IsOk());
    EXPECT_TRUE(result->rejected.empty());
    std::vector<std::vector<ModeNumber>> visited = VisitedModes(world, 4);
    for (const auto& modes : visited) wanted += static_cast<int>(modes.size());
    std::vector<std::pair<std::size_t, ModeNumber>> seen;
    for (const MatchedMode& mode : MatchModes(result->content, world)) {
      const bool again =
          std::count(seen.begin(), seen.end(), std::pair(mode.group, mode.truth)) > 0;
      const bool right = !again && mode.error.norm() < 0.5;
      found += right;
      spurious += !right;
      if (right) squared += mode.error.squaredNorm();
      seen.emplace_back(mode.group, mode.truth);
    }
  }
  EXPECT_GE(found, wanted - 2);
  EXPECT_LE(spurious, 2);
  EXPECT_LT(std::sqrt(squared / found), 0.12);
}

TEST(TreeBuilder, GoesOnFromAMap) {
  const SimulatedWorld world = Simulate(SmallWorld(5));
  std::vector<MapperInput> inputs = Inputs(world);
  const MapperInput last = inputs.back();
  inputs.pop_back();
  const auto first = BuildMapByTree(inputs, std::nullopt, Options(), {});
  ASSERT_THAT(first, IsOk());
  const auto second = BuildMapByTree({last}, first->content, Options(), {});
  ASSERT_THAT(second, IsOk());
  ASSERT_EQ(second->runs.size(), 1u);
  for (const LandmarkGroup& group : first->content.groups) {
    const auto same = std::find_if(
        second->content.groups.begin(), second->content.groups.end(), [&](const auto& other) {
          return other.signature == group.signature;
        });
    ASSERT_NE(same, second->content.groups.end());
    for (const Mode& mode : group.modes) EXPECT_GT(same->StateOf(mode.number), 0);
  }
  EXPECT_FALSE(second->runs[0].evidence.empty());
}

TEST(TreeBuilder, DoesNotDependOnTheOrderOfTheRuns) {
  std::vector<MapperInput> inputs = Inputs(Simulate(SmallWorld(6)));
  const auto one = BuildMapByTree(inputs, std::nullopt, Options(), {});
  std::reverse(inputs.begin(), inputs.end());
  const auto other = BuildMapByTree(inputs, std::nullopt, Options(), {});
  ASSERT_THAT(one, IsOk());
  ASSERT_THAT(other, IsOk());
  EXPECT_EQ(ContentHash(one->content), ContentHash(other->content));
}

TEST(TreeBuilder, LeavesOutARunFromElsewhere) {
  std::vector<MapperInput> inputs = Inputs(Simulate(SmallWorld(7)));
  MapperInput& stranger = inputs.back();
  for (Scan& scan : stranger.run.scans) {
    for (Observation& observation : scan.observations) {
      observation.signature = Signature("X" + observation.signature.text());
    }
  }
  const auto result = BuildMapByTree(inputs, std::nullopt, Options(), {});
  ASSERT_THAT(result, IsOk());
  ASSERT_EQ(result->rejected.size(), 1u);
  EXPECT_EQ(result->rejected[0].name, stranger.name);
}

// A first run that sees each landmark once maps nothing; the others are mapped without it.
TEST(TreeBuilder, AUselessFirstRunCostsOnlyItself) {
  std::vector<MapperInput> inputs = Inputs(Simulate(SmallWorld(9)));
  std::vector<Scan>& scans = inputs.front().run.scans;
  const auto seen = std::find_if(
      scans.begin(), scans.end(), [](const Scan& scan) { return !scan.observations.empty(); });
  ASSERT_NE(seen, scans.end());
  scans = {*seen};
  const auto result = BuildMapByTree(inputs, std::nullopt, Options(), {});
  ASSERT_THAT(result, IsOk());
  ASSERT_EQ(result->rejected.size(), 1u);
  EXPECT_EQ(result->rejected[0].name, inputs.front().name);
  EXPECT_EQ(result->runs.size(), inputs.size() - 1);
}

TEST(TreeBuilder, NeedsARun) {
  EXPECT_THAT(BuildMapByTree({}, std::nullopt, Options(), {}),
              StatusIs(StatusCode::kInvalidArgument, "no runs"));
}

TEST(TreeBuilder, StopsWhenAsked) {
  const auto result =
      BuildMapByTree(Inputs(Simulate(SmallWorld(8))), std::nullopt, Options(), {}, [](const auto&) {
        return false;
      });
  EXPECT_EQ(result.status().code(), StatusCode::kCancelled);
}

TEST(TreeBuilder, RefusesMoreLandmarksThanFitIntoMemory) {
  MapperOptions options = Options();
  options.max_memory_bytes = 1000;
  const auto result = BuildMapByTree(Inputs(Simulate(SmallWorld(8))), std::nullopt, options, {});
  EXPECT_THAT(result, StatusIs(StatusCode::kInvalidArgument, "graph engine"));
}

TEST(TreeBuilder, RefusesOptionsOutOfRange) {
  const auto result =
      BuildMapByTree(Inputs(Simulate(SmallWorld(8))), std::nullopt, Options(), {.max_leaves = 0});
  EXPECT_EQ(result.status().code(), StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "tools/eval/map_error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

// Landmarks with two modes each, in a map frame of their own, and one true place per landmark.
struct World {
  explicit World(const Se2& T_truth_map) {
    std::mt19937_64 random(testing::TestSeed(4));
    std::uniform_real_distribution<double> coordinate(0.0, 50.0);
    for (int g = 0; g < 12; ++g) {
      LandmarkGroup group = testing::RandomGroup(random, fmt::format("{}", 10 + g), 2);
      for (Mode& mode : group.modes) {
        const double x = coordinate(random);
        mode.p_map_landmark = {x, coordinate(random)};
      }
      const Mode& there = group.modes[static_cast<std::size_t>(g % 2)];
      truth.push_back({group.signature, T_truth_map * there.p_map_landmark});
      groups.push_back(std::move(group));
    }
  }

  std::vector<LandmarkGroup> groups;
  std::vector<TruePlace> truth;
};

TEST(MapError, FindsTheFrameAndTheModes) {
  const Se2 T_truth_map(-30.0, 12.0, 2.2);
  const World world(T_truth_map);
  const auto error = EvaluateMap(world.groups, world.truth, true);
  ASSERT_THAT(error, IsOk());
  EXPECT_NEAR(error->max_m, 0.0, 1e-9);
  EXPECT_THAT(error->T_truth_map, testing::IsNearPose(T_truth_map, 1e-9));
  ASSERT_EQ(error->matches.size(), 12U);
  EXPECT_EQ(error->matches[0].mode, world.groups[0].modes[0].number);
  EXPECT_EQ(error->matches[1].mode, world.groups[1].modes[1].number);
}

TEST(MapError, OneWrongPlaceDoesNotMoveTheFrame) {
  const Se2 T_truth_map(-30.0, 12.0, 2.2);
  World world(T_truth_map);
  world.truth[3].p_truth += Eigen::Vector2d(300.0, 0.0);
  const auto error = EvaluateMap(world.groups, world.truth, true);
  ASSERT_THAT(error, IsOk());
  EXPECT_THAT(error->T_truth_map, testing::IsNearPose(T_truth_map, 1e-9));
  EXPECT_GT(error->max_m, 200.0);
  EXPECT_NEAR(error->median_m, 0.0, 1e-9);
}

TEST(MapError, WithoutAlignmentTheFrameIsTheMaps) {
  World world{Se2()};
  for (TruePlace& place : world.truth) place.p_truth += Eigen::Vector2d(0.3, 0.4);
  const auto error = EvaluateMap(world.groups, world.truth, false);
  ASSERT_THAT(error, IsOk());
  EXPECT_NEAR(error->rmse_m, 0.5, 1e-9);
}

TEST(MapError, NamesLandmarksThatTheMapDoesNotHave) {
  World world{Se2()};
  world.truth.push_back({Signature("none"), {1.0, 1.0}});
  const auto error = EvaluateMap(world.groups, world.truth, false);
  ASSERT_THAT(error, IsOk());
  EXPECT_THAT(error->unmatched, ::testing::ElementsAre(Signature("none")));
  EXPECT_THAT(EvaluateMap({}, world.truth, true),
              StatusIs(StatusCode::kInvalidArgument, "none of"));
}

TEST(TruePlaces, ReadsColumnsByName) {
  const testing::TempDir dir;
  testing::WriteFile(dir.File("a.csv"), "signature,mode,x_m,y_m\r\n18,1,2.5,-3\r\n\r\n");
  const auto places = ReadTruePlaces(dir.File("a.csv"));
  ASSERT_THAT(places, IsOk());
  ASSERT_EQ(places->size(), 1U);
  EXPECT_EQ(places->front().signature.text(), "18");
  EXPECT_EQ(places->front().p_truth, Eigen::Vector2d(2.5, -3.0));
}

TEST(TruePlaces, NamesTheLineThatIsWrong) {
  const testing::TempDir dir;
  testing::WriteFile(dir.File("a.csv"), "signature,x_m,y_m\n18,2.5,x\n");
  EXPECT_THAT(ReadTruePlaces(dir.File("a.csv")), StatusIs(StatusCode::kInvalidArgument, "csv:2"));
  testing::WriteFile(dir.File("a.csv"), "name,x_m,y_m\n");
  EXPECT_THAT(ReadTruePlaces(dir.File("a.csv")), StatusIs(StatusCode::kInvalidArgument, "csv:1"));
  EXPECT_THAT(ReadTruePlaces(dir.File("b.csv")), StatusIs(StatusCode::kNotFound, "b.csv"));
}

}  // namespace
}  // namespace shiftmap

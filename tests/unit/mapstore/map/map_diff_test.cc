// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/map_diff.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <random>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class MapDiffTest : public ::testing::Test {
 protected:
  std::mt19937_64 random_{TestSeed(51)};
  const MapContent map_ = RandomContent(random_, {.groups = 12});
};

TEST_F(MapDiffTest, OfAMapWithItselfIsEmpty) { EXPECT_TRUE(DiffMaps(map_, map_).empty()); }

TEST_F(MapDiffTest, ListsExactlyWhatWasEdited) {
  MapContent to = map_;
  LandmarkGroup& moved = to.groups[2];
  moved.modes[0].p_map_landmark += Eigen::Vector2d(0.3, -0.4);
  LandmarkGroup& grown = to.groups[5];
  Mode mode = grown.modes.back();
  mode.number = grown.NextNumber();
  grown.modes.push_back(mode);
  grown.probabilities.conservativeResize(grown.probabilities.size() + 1);
  grown.probabilities.tail(1).setZero();
  LandmarkGroup& merged = to.groups[7];
  const ModeNumber gone = merged.modes.back().number;
  const ModeNumber into(99);
  merged.modes.back().number = into;
  merged.merged = {{gone, into}};
  to.calibration.sensor.sd_range_m *= 2.0;
  const Signature removed = to.groups.back().signature;
  to.groups.pop_back();

  const MapDiff diff = DiffMaps(map_, to);
  EXPECT_THAT(diff.groups_added, IsEmpty());
  EXPECT_THAT(diff.groups_removed, ElementsAre(removed));
  ASSERT_THAT(diff.groups, SizeIs(3));
  ASSERT_THAT(diff.groups[0].moved, SizeIs(1));
  const MovedMode& move = diff.groups[0].moved[0];
  EXPECT_THAT(move.displacement_m, IsNearMatrix(Eigen::Vector2d(0.3, -0.4), 1e-12));
  const Eigen::Matrix2d cov =
      map_.groups[2].modes[0].cov_p_map_landmark + moved.modes[0].cov_p_map_landmark;
  const double squared = move.displacement_m.dot(cov.inverse() * move.displacement_m);
  EXPECT_NEAR(move.squared_mahalanobis, squared, 1e-9 * squared);
  // Chi-square with 2 degrees of freedom has a closed form.
  EXPECT_NEAR(move.p_value, std::exp(-0.5 * squared), 1e-12);
  EXPECT_EQ(diff.groups[0].probability_change, 0.0);
  EXPECT_THAT(diff.groups[1].added, ElementsAre(mode.number));
  ASSERT_THAT(diff.groups[2].merged, SizeIs(1));
  EXPECT_EQ(diff.groups[2].merged[0].into, into);
  EXPECT_THAT(diff.groups[2].removed, IsEmpty());
  ASSERT_THAT(diff.calibration, SizeIs(1));
  EXPECT_STREQ(diff.calibration[0].name.c_str(), "sensor_sd_range_m");
}

TEST_F(MapDiffTest, NamesVehiclesAndTheirValues) {
  MapContent from = map_;
  for (const char* name : {"a", "b", "c"}) from.vehicles.push_back(RandomVehicle(random_, name));
  MapContent to = from;
  to.vehicles.erase(to.vehicles.begin());
  to.vehicles[0].lag_s.value = 0.7;
  to.vehicles.push_back(RandomVehicle(random_, "d"));
  const MapDiff diff = DiffMaps(from, to);
  EXPECT_FALSE(diff.empty());
  EXPECT_THAT(diff.vehicles_removed, ElementsAre("a"));
  EXPECT_THAT(diff.vehicles_added, ElementsAre("d"));
  ASSERT_THAT(diff.calibration, SizeIs(1));
  EXPECT_EQ(diff.calibration[0].vehicle, "b");
  EXPECT_EQ(diff.calibration[0].name, "lag_s");
  EXPECT_EQ(diff.calibration[0].to, 0.7);
}

TEST_F(MapDiffTest, TurnedRoundAddedIsRemovedAndMovesChangeSign) {
  MapContent to = map_;
  to.groups.erase(to.groups.begin());
  to.groups[3].modes.back().p_map_landmark.x() += 1.0;
  to.groups[4].chain = ModeChain::Uniform(static_cast<int>(to.groups[4].modes.size()), 0.123);
  to.groups[6].probabilities.reverseInPlace();
  const MapDiff there = DiffMaps(map_, to);
  const MapDiff back = DiffMaps(to, map_);
  EXPECT_EQ(there.groups_removed, back.groups_added);
  ASSERT_EQ(there.groups.size(), back.groups.size());
  for (std::size_t i = 0; i < there.groups.size(); ++i) {
    EXPECT_EQ(there.groups[i].rates_changed, back.groups[i].rates_changed);
    EXPECT_DOUBLE_EQ(there.groups[i].probability_change, back.groups[i].probability_change);
    ASSERT_EQ(there.groups[i].moved.size(), back.groups[i].moved.size());
    for (std::size_t j = 0; j < there.groups[i].moved.size(); ++j) {
      EXPECT_EQ(there.groups[i].moved[j].displacement_m, -back.groups[i].moved[j].displacement_m);
      EXPECT_DOUBLE_EQ(there.groups[i].moved[j].p_value, back.groups[i].moved[j].p_value);
    }
  }
}

}  // namespace
}  // namespace shiftmap::testing

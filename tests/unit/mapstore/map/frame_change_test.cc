// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/frame_change.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "mapstore/map/map_diff.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/mapstore/map/edit_test_util.h"

namespace shiftmap::testing {
namespace {

class FrameChangeTest : public ::testing::Test {
 protected:
  FrameChangeTest() {
    std::mt19937_64 random(TestSeed(17));
    from_ = RandomContent(random, {.groups = 12, .anonymous_landmarks = 3});
    for (LandmarkGroup& group : from_.groups) {
      for (Mode& mode : group.modes) mode.cov_p_map_landmark = 1e-4 * Eigen::Matrix2d::Identity();
    }
    from_ = WithNames(from_, LandmarkNames(), LandmarkNames());
    to_ = from_;
    MoveContent(T_to_from_, &to_);
  }

  CarriedMap Carry() const { return CarryMap(from_, LandmarkNames(), to_, LandmarkNames()); }

  static void ExpectNear(const Se2& a, const Se2& b, double tolerance) {
    const Eigen::Vector3d error = (a.Inverse() * b).Log();
    EXPECT_LT(error.cwiseAbs().maxCoeff(), tolerance);
  }

  const Se2 T_to_from_{12.0, -3.0, 0.4};
  MapContent from_;
  MapContent to_;
};

TEST_F(FrameChangeTest, AMapThatMovedAsAWholeDiffersInItsFrameOnly) {
  const CarriedMap carried = Carry();
  ASSERT_TRUE(carried.moved);
  EXPECT_THAT(ValidateMapContent(carried.content), IsOk());
  ExpectNear(*carried.moved, T_to_from_, 1e-9);
  EXPECT_TRUE(DiffMaps(carried.content, to_).empty());
  ExpectNear(FitFrame(from_, to_), T_to_from_, 1e-9);
}

// The oracle: the very motion, whatever two landmarks did beyond it.
TEST_F(FrameChangeTest, LandmarksThatWentElsewhereDoNotPullTheFrame) {
  to_.groups[2].modes[0].p_map_landmark += Eigen::Vector2d(4.0, 0.0);
  to_.groups[7].modes[0].p_map_landmark += Eigen::Vector2d(-1.0, 9.0);
  const CarriedMap carried = Carry();
  ASSERT_TRUE(carried.moved);
  ExpectNear(*carried.moved, T_to_from_, 1e-6);
  const MapDiff diff = DiffMaps(carried.content, to_);
  ASSERT_EQ(diff.groups.size(), 2U);
  ASSERT_EQ(diff.groups[0].moved.size(), 1U);
  EXPECT_NEAR(diff.groups[0].moved[0].displacement_m.x(), 4.0, 1e-5);
  EXPECT_NEAR(diff.groups[1].moved[0].displacement_m.y(), 9.0, 1e-5);
}

TEST_F(FrameChangeTest, MovesOfSingleLandmarksAreNoMotionOfTheFrame) {
  to_ = from_;
  for (std::size_t i = 0; i < 4; ++i) {
    to_.groups[i].modes[0].p_map_landmark += Eigen::Vector2d(1.0, 0.5);
  }
  const CarriedMap carried = Carry();
  EXPECT_FALSE(carried.moved);
  EXPECT_EQ(DiffMaps(carried.content, to_).groups.size(), 4U);
}

// Noise of the size of the covariance, in a frame that did not move.
TEST_F(FrameChangeTest, ShiftsWithinTheirCovarianceAreNoMotionOfTheFrame) {
  to_ = from_;
  for (LandmarkGroup& group : to_.groups) {
    for (Mode& mode : group.modes) mode.p_map_landmark += Eigen::Vector2d(0.008, -0.006);
  }
  EXPECT_FALSE(Carry().moved);
}

TEST_F(FrameChangeTest, ARenamedLandmarkIsTheSame) {
  const Signature old = from_.groups[3].signature;
  const LandmarkNames names({MakeRename(old.text(), "zz-gate", 1)});
  to_ = WithNames(to_, LandmarkNames(), names);
  const CarriedMap carried = CarryMap(from_, LandmarkNames(), to_, names);
  EXPECT_THAT(carried.renamed, ::testing::ElementsAre(std::pair(old, Signature("zz-gate"))));
  EXPECT_TRUE(DiffMaps(carried.content, to_).empty());
  // And back, as when the rename is taken back.
  const CarriedMap back = CarryMap(to_, names, from_, LandmarkNames());
  EXPECT_THAT(back.renamed, ::testing::ElementsAre(std::pair(Signature("zz-gate"), old)));
  EXPECT_TRUE(DiffMaps(back.content, from_).empty());
}

TEST_F(FrameChangeTest, TooFewModesInCommonTellNothing) {
  MapContent none;
  EXPECT_FALSE(CarryMap(none, LandmarkNames(), to_, LandmarkNames()).moved);
  ExpectNear(FitFrame(none, to_), Se2(), 1e-12);
}

}  // namespace
}  // namespace shiftmap::testing

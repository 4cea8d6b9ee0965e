// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/unseen_way.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace shiftmap {
namespace {

MotionIncrement Step(double length_m, double turn_rad) {
  MotionIncrement increment;
  increment.T_begin_end = Se2::Exp({length_m, 0.0, turn_rad});
  return increment;
}

TEST(UnseenWay, ASlipIsAlongAStraightWayAndNoLongerThanIt) {
  UnseenWay way;
  for (int i = 0; i < 10; ++i) way.Add(Step(0.1, 0.0));
  EXPECT_NEAR(way.length_m(), 1.0, 1e-12);
  EXPECT_NEAR(way.SlipCovariance()(0, 0), 1.0 / 3.0, 1e-9);
  EXPECT_NEAR(way.SlipCovariance()(1, 1), 0.0, 1e-12);
  for (int i = 0; i < 90; ++i) way.Add(Step(0.1, 0.0));
  EXPECT_NEAR(way.SlipCovariance()(0, 0), UnseenWay::kMaxSlip * UnseenWay::kMaxSlip / 3.0, 1e-9);
}

// The oracle is the mean over slips all along the way.
TEST(UnseenWay, ASlipKeepsTheHeadingThatItHad) {
  constexpr int kSteps = 1000;
  constexpr double kTurn = 0.5 * std::numbers::pi;
  UnseenWay way;
  Eigen::Matrix2d expected = Eigen::Matrix2d::Zero();
  for (int i = 0; i < kSteps; ++i) {
    way.Add(Step(1.0 / kSteps, kTurn / kSteps));
    const double turned = kTurn * (i + 0.5) / kSteps - kTurn;
    const Eigen::Vector2d slip(std::cos(turned), std::sin(turned));
    expected += slip * slip.transpose() / kSteps / 3.0;
  }
  EXPECT_LT((way.SlipCovariance() - expected).norm(), 1e-3);
}

TEST(UnseenWay, NoneIsLeftOnceAPoseIsConfirmed) {
  UnseenWay way;
  way.Add(Step(1.0, 0.3));
  way.Clear();
  EXPECT_EQ(way.length_m(), 0.0);
  EXPECT_TRUE(way.SlipCovariance().isZero(0.0));
}

}  // namespace
}  // namespace shiftmap

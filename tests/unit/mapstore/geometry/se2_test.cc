// SPDX-License-Identifier: Apache-2.0
#include "mapstore/geometry/se2.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/support/geometry_matchers.h"

namespace shiftmap::testing {
namespace {

constexpr double kPi = std::numbers::pi;

TEST(Se2Test, QuarterTurnByHand) {
  const Se2 T_map_vehicle(1.0, 2.0, kPi / 2.0);
  const Eigen::Vector2d p_map = T_map_vehicle * Eigen::Vector2d(3.0, 1.0);
  EXPECT_NEAR(p_map.x(), 0.0, 1e-15);
  EXPECT_NEAR(p_map.y(), 5.0, 1e-15);
  EXPECT_THAT(T_map_vehicle * Se2(1.0, 0.0, kPi / 2.0), IsNearPose(Se2(1.0, 3.0, kPi), 1e-15));
  EXPECT_THAT(T_map_vehicle.Inverse(), IsNearPose(Se2(-2.0, 1.0, -kPi / 2.0), 1e-15));
}

TEST(Se2Test, YawIsWrapped) {
  EXPECT_NEAR(Se2(0.0, 0.0, 3.0 * kPi / 2.0).yaw(), -kPi / 2.0, 1e-15);
}

TEST(Se2Test, ExpOfAConstantTwistIsAnArc) {
  // Half a circle of radius 2.
  EXPECT_THAT(Se2::Exp({2.0 * kPi, 0.0, kPi}), IsNearPose(Se2(0.0, 4.0, kPi), 1e-14));
  EXPECT_THAT(Se2::Exp({3.0, -1.0, 0.0}), IsNearPose(Se2(3.0, -1.0, 0.0), 0.0));
}

TEST(Se2Test, InverseAdjointIsTheAdjointOfTheInverse) {
  const Se2 T(1.5, -0.7, 2.1);
  EXPECT_TRUE(T.InverseAdjoint().isApprox(T.Inverse().Adjoint(), 1e-14));
  EXPECT_TRUE((T.InverseAdjoint() * T.Adjoint()).isIdentity(1e-14));
}

TEST(Se2Test, ExpStepIsItsParts) {
  for (const double yaw : {0.0, 1e-5, -3e-3, 0.4, -2.9}) {
    const Eigen::Vector3d twist(0.8, -0.3, yaw);
    const Se2::Step step = Se2::ExpStep(twist);
    EXPECT_THAT(step.T, IsNearPose(Se2::Exp(twist), 1e-15));
    EXPECT_TRUE(step.inverse_adjoint.isApprox(Se2::Exp(twist).InverseAdjoint(), 1e-14));
    EXPECT_TRUE(step.right_jacobian.isApprox(Se2::RightJacobian(twist), 1e-14));
  }
}

}  // namespace
}  // namespace shiftmap::testing

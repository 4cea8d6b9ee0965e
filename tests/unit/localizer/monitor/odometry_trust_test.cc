// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/odometry_trust.h"

#include <gtest/gtest.h>

namespace shiftmap {
namespace {

// A vehicle that drives at 0.5 m and `turn_rad` a step, by odometry that has a share of each.
bool IsTrustedAfter(int steps, double turn_rad, double way_share, double turn_share) {
  OdometryTrust trust;
  trust.Distrust();
  Se2 T_map_vehicle(1.0, 2.0, 0.5);
  for (int i = 0; i <= steps; ++i) {
    trust.Compare({T_map_vehicle, 1e-4 * Eigen::Matrix3d::Identity()});
    T_map_vehicle = T_map_vehicle * Se2::Exp({0.5, 0.0, turn_rad});
    trust.Move(Se2::Exp({0.5 * way_share, 0.0, turn_rad * turn_share}));
  }
  return trust.trusted();
}

TEST(OdometryTrust, IsThereFromTheBeginning) { EXPECT_TRUE(OdometryTrust().trusted()); }

TEST(OdometryTrust, ReturnsAfterAWayAndATurnThatOdometryAgreesWith) {
  EXPECT_FALSE(IsTrustedAfter(1, 0.2, 1.0, 1.0));
  EXPECT_TRUE(IsTrustedAfter(6, 0.2, 1.0, 1.0));
  EXPECT_TRUE(IsTrustedAfter(6, 0.2, 1.03, 0.97));
}

// Landmarks have not shown how good it is at what the vehicle did not do.
TEST(OdometryTrust, DoesNotReturnOnAStraightWay) {
  EXPECT_FALSE(IsTrustedAfter(100, 0.0, 1.0, 1.0));
}

TEST(OdometryTrust, DoesNotReturnAsLongAsOdometryIsWrong) {
  for (const double turn_share : {0.0, -1.0, 0.5, 2.0}) {
    EXPECT_FALSE(IsTrustedAfter(100, 0.2, 1.0, turn_share)) << turn_share;
    EXPECT_FALSE(IsTrustedAfter(100, -0.05, 1.0, turn_share)) << turn_share;
  }
  for (const double way_share : {0.0, 0.5, 2.0}) {
    EXPECT_FALSE(IsTrustedAfter(100, 0.1, way_share, 1.0)) << way_share;
  }
}

TEST(OdometryTrust, AVaguePoseSaysNothing) {
  OdometryTrust trust;
  trust.Distrust();
  Se2 T_vehicle;
  for (int i = 0; i < 100; ++i) {
    trust.Compare({T_vehicle, 0.04 * Eigen::Matrix3d::Identity()});
    T_vehicle = T_vehicle * Se2::Exp({0.5, 0.0, 0.2});
    trust.Move(Se2::Exp({0.5, 0.0, 0.2}));
  }
  EXPECT_FALSE(trust.trusted());
}

}  // namespace
}  // namespace shiftmap

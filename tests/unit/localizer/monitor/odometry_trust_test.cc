// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/odometry_trust.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace shiftmap {
namespace {

struct Drive {
  double turn_rad = 0.2;  // A step of half a metre.
  double way_share = 1.0;
  double turn_share = 1.0;
  double sd = 0.01;          // Of the poses, in m and rad.
  int steps_standing = 0;    // Before it.
  double noise_rad = 0.005;  // Of odometry, a step.
};

// Whether odometry that was wrong is trusted after some steps.
bool IsTrustedAfter(int steps, const Drive& drive) {
  OdometryTrust trust;
  trust.Distrust();
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0.0, drive.noise_rad);
  Se2 T_map_vehicle(1.0, 2.0, 0.5);
  const auto compare = [&] {
    trust.Compare({T_map_vehicle, drive.sd * drive.sd * Eigen::Matrix3d::Identity()});
  };
  for (int i = 0; i < drive.steps_standing; ++i) {
    compare();
    trust.Move(Se2::Exp({0.0, 0.0, noise(random)}));
  }
  compare();
  for (int i = 0; i < steps; ++i) {
    T_map_vehicle = T_map_vehicle * Se2::Exp({0.5, 0.0, drive.turn_rad});
    trust.Move(
        Se2::Exp({0.5 * drive.way_share, 0.0, drive.turn_rad * drive.turn_share + noise(random)}));
    compare();
  }
  return trust.trusted();
}

TEST(OdometryTrust, IsThereFromTheBeginning) { EXPECT_TRUE(OdometryTrust().trusted()); }

TEST(OdometryTrust, ReturnsAfterAWayAndATurnThatOdometryAgreesWith) {
  EXPECT_FALSE(IsTrustedAfter(1, {}));
  EXPECT_TRUE(IsTrustedAfter(8, {}));
  EXPECT_TRUE(IsTrustedAfter(8, {.way_share = 1.03, .turn_share = 0.97}));
  EXPECT_TRUE(IsTrustedAfter(12, {.sd = 0.05}));
}

// Landmarks have not shown how good it is at what the vehicle did not do.
TEST(OdometryTrust, DoesNotReturnOnAStraightWay) {
  EXPECT_FALSE(IsTrustedAfter(100, {.turn_rad = 0.0}));
}

TEST(OdometryTrust, DoesNotReturnAsLongAsOdometryIsWrong) {
  for (const double sd : {0.01, 0.03, 0.06}) {
    for (const int steps_standing : {0, 400, 4000}) {
      for (const double turn_share : {0.0, -1.0, 2.0}) {
        for (const double turn_rad : {0.2, -0.05}) {
          EXPECT_FALSE(IsTrustedAfter(100,
                                      {.turn_rad = turn_rad,
                                       .turn_share = turn_share,
                                       .sd = sd,
                                       .steps_standing = steps_standing}))
              << turn_share << " of " << turn_rad << " rad, " << sd << ", " << steps_standing;
        }
      }
      for (const double way_share : {0.0, 2.0}) {
        EXPECT_FALSE(IsTrustedAfter(
            100, {.way_share = way_share, .sd = sd, .steps_standing = steps_standing}))
            << way_share << ", " << sd << ", " << steps_standing;
      }
    }
  }
}

TEST(OdometryTrust, DoesNotReturnIfHalfOfAMotionIsCounted) {
  EXPECT_FALSE(IsTrustedAfter(100, {.turn_share = 0.5}));
  EXPECT_FALSE(IsTrustedAfter(100, {.way_share = 0.5}));
}

TEST(OdometryTrust, ReturnsWhenTheMapConfirmsATurnOrALongWay) {
  const auto is_trusted_after = [](int steps, const Se2& step) {
    OdometryTrust trust;
    trust.Distrust();
    trust.Agree(std::vector<Se2>(static_cast<std::size_t>(steps), step));
    return trust.trusted();
  };
  EXPECT_FALSE(is_trusted_after(0, Se2()));
  EXPECT_TRUE(is_trusted_after(6, Se2(0.2, 0.0, 0.1)));
  EXPECT_FALSE(is_trusted_after(4, Se2(0.2, 0.0, 0.2)));  // Less than a metre.
  EXPECT_FALSE(is_trusted_after(20, Se2(0.4, 0.0, 0.0)));
  EXPECT_TRUE(is_trusted_after(30, Se2(0.4, 0.0, 0.0)));
}

// A jump of the pose is no motion.
TEST(OdometryTrust, BeginsAnewAtAnotherPose) {
  OdometryTrust trust;
  trust.Distrust();
  const Eigen::Matrix3d cov = 1e-4 * Eigen::Matrix3d::Identity();
  trust.Compare({Se2(), cov});
  trust.Move(Se2(2.0, 0.0, 1.0));
  trust.Restart();
  trust.Compare({Se2(2.0, 0.0, 1.0), cov});
  EXPECT_FALSE(trust.trusted());
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/pose_odometry.h"

#include <gtest/gtest.h>

#include <cmath>

namespace shiftmap::rosbag2 {
namespace {

Stamp At(double seconds) { return StampFromSeconds(1.7e9) + FromSeconds(seconds); }

TEST(PoseOdometry, GivesBackTheVelocitiesOfADrive) {
  std::vector<OdometrySample> driven;
  std::vector<StampedPose> poses = {{At(0.0), Se2(5.0, -3.0, 2.0)}};
  for (int i = 0; i < 200; ++i) {
    const double seconds = 0.05 + 0.01 * (i % 3);
    const OdometrySample sample{poses.back().stamp, std::cos(0.1 * i), std::sin(0.07 * i)};
    driven.push_back(sample);
    const Eigen::Vector3d twist(sample.v_mps * seconds, 0.0, sample.omega_radps * seconds);
    poses.push_back(
        {sample.stamp + FromSeconds(seconds), poses.back().T_map_vehicle * Se2::Exp(twist)});
  }
  const std::vector<OdometrySample> odometry = OdometryOfPoses(poses);
  ASSERT_EQ(odometry.size(), driven.size() + 1);
  for (std::size_t i = 0; i < driven.size(); ++i) {
    EXPECT_EQ(odometry[i].stamp, driven[i].stamp);
    EXPECT_NEAR(odometry[i].v_mps, driven[i].v_mps, 1e-9);
    EXPECT_NEAR(odometry[i].omega_radps, driven[i].omega_radps, 1e-9);
  }
  EXPECT_EQ(odometry.back().v_mps, odometry[driven.size() - 1].v_mps);
}

TEST(PoseOdometry, RepeatedStampsAndSinglePosesGiveNoInfiniteVelocity) {
  EXPECT_TRUE(OdometryOfPoses({}).empty());
  const std::vector<StampedPose> twice = {{At(0.0), Se2()}, {At(0.0), Se2(1.0, 0.0, 0.0)}};
  const std::vector<OdometrySample> odometry = OdometryOfPoses(twice);
  ASSERT_EQ(odometry.size(), 1U);
  EXPECT_EQ(odometry[0].v_mps, 0.0);
}

}  // namespace
}  // namespace shiftmap::rosbag2

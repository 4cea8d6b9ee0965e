// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/implausible_calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

// A run of a metre a second whose odometry is right, but for what a test changes.
class ImplausibleCalibrationTest : public ::testing::Test {
 protected:
  static constexpr int kFrames = 11;

  ImplausibleCalibrationTest() {
    run_.data = &data_;
    for (int i = 0; i < kFrames; ++i) {
      data_.frames.push_back({StampFromSeconds(1000.0 + i), {}, 0});
      run_.poses.emplace_back(1.0 * i, 0.0, 0.1 * i);
    }
    for (FrameIndex i; i + 1 < run_.poses.end_index(); ++i) {
      run_.motions.between_frames.push_back({run_.poses[i].Inverse() * run_.poses[i + 1]});
    }
  }

  std::string Reason(const PlausibilityOptions& options = {}) const {
    return ImplausibleCalibration(options, run_, sensor_);
  }

  MappingRun data_;
  BuildRun run_;
  SensorCalibration sensor_;
};

TEST_F(ImplausibleCalibrationTest, ARunWhoseOdometryIsRightIsPlausible) {
  EXPECT_THAT(Reason(), IsEmpty());
}

TEST_F(ImplausibleCalibrationTest, ASensorIsMountedAboutAsTheLogSays) {
  run_.sensor_bias[kBearingOffset] = 0.7;
  EXPECT_THAT(Reason(), HasSubstr("turned by 40 degrees"));
  EXPECT_THAT(Reason({.max_bearing_offset_rad = 0.8}), IsEmpty());
}

TEST_F(ImplausibleCalibrationTest, ScalesAreThoseOfOneUnit) {
  run_.odometry.scale_v = 0.4;
  EXPECT_THAT(Reason(), HasSubstr("speeds of 0.40 times"));
  EXPECT_THAT(Reason({.max_scale = 3.0}), IsEmpty());
  run_.odometry.scale_v = 1.0;
  run_.odometry.scale_omega = 2.5;
  EXPECT_THAT(Reason(), HasSubstr("yaw rates of 2.50 times"));
  EXPECT_THAT(Reason({.max_scale = 3.0}), IsEmpty());
}

TEST_F(ImplausibleCalibrationTest, NoiseIsThatOfAWorkingVehicle) {
  run_.odometry.noise_omega = 0.2;
  EXPECT_THAT(Reason(), HasSubstr("loses the heading"));
  EXPECT_THAT(Reason({.max_noise_omega = 0.3}), IsEmpty());
  run_.odometry.noise_omega = 0.01;
  sensor_.sd_bearing_rad = 0.6;
  EXPECT_THAT(Reason(), HasSubstr("bearings that are wrong"));
  EXPECT_THAT(Reason({.max_sd_bearing_rad = 0.7}), IsEmpty());
}

TEST_F(ImplausibleCalibrationTest, OdometryCountsForwards) {
  for (IntegratedMotion& motion : run_.motions.between_frames) {
    const Se2& forwards = motion.T_begin_end;
    motion.T_begin_end = Se2(-forwards.x(), -forwards.y(), forwards.yaw());
  }
  EXPECT_THAT(Reason(), HasSubstr("drives the other way"));
  EXPECT_THAT(Reason({.reversed_log_odds = 1e3}), IsEmpty());
  EXPECT_THAT(Reason({.max_noise_v = 10.0}), IsEmpty());
}

TEST_F(ImplausibleCalibrationTest, OdometryTurnsTheWayThatBearingsDo) {
  for (IntegratedMotion& motion : run_.motions.between_frames) {
    motion.T_begin_end = Se2(motion.T_begin_end.translation(), -motion.T_begin_end.yaw());
  }
  EXPECT_THAT(Reason(), HasSubstr("turns the other way"));
  EXPECT_THAT(Reason({.reversed_log_odds = 1e3}), IsEmpty());
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/pose_predictor.h"

#include <gtest/gtest.h>

#include "localizer/models/motion_model.h"
#include "tests/support/geometry_matchers.h"

namespace shiftmap::live {
namespace {

using testing::IsNearMatrix;
using testing::IsNearPose;

OdometryCalibration Lagging() {
  OdometryCalibration calibration;
  calibration.scale_v = 0.9;
  calibration.lag_s = 0.12;
  return calibration;
}

// One integration over all of the odometry is the oracle; how often scans come must not matter.
TEST(PosePredictorTest, EqualsOneIntegrationOverAllOdometry) {
  const OdometryCalibration calibration = Lagging();
  PosePredictor predictor(calibration);
  std::vector<OdometrySample> samples;
  const Stamp begin = StampFromSeconds(1000.0);
  PoseEstimate start{begin + FromSeconds(1.0),
                     {Se2(3.0, -2.0, 0.7), Eigen::Matrix3d::Identity() * 0.01}};
  EXPECT_FALSE(predictor.At(begin));
  for (int i = 0; i < 1000; ++i) {
    const OdometrySample sample{
        .stamp = begin + FromSeconds(0.05 * i), .v_mps = 0.5 + 0.001 * i, .omega_radps = 0.3};
    samples.push_back(sample);
    predictor.Add(sample);
    if (sample.stamp < start.stamp) continue;
    if (sample.stamp == start.stamp) predictor.Correct(start);
    std::size_t hint = 0;
    const MotionIncrement motion =
        IntegrateMotion(samples, start.stamp, sample.stamp, calibration, &hint);
    const auto pose = predictor.At(sample.stamp);
    ASSERT_TRUE(pose);
    ASSERT_THAT(pose->pose.T_map_vehicle,
                IsNearPose(start.pose.T_map_vehicle * motion.T_begin_end, 1e-9));
    const Eigen::Matrix3d F = motion.T_begin_end.Inverse().Adjoint();
    const Eigen::Matrix3d cov = F * start.pose.cov_T_map_vehicle * F.transpose() + motion.cov;
    ASSERT_THAT(pose->pose.cov_T_map_vehicle, IsNearMatrix(cov, 1e-3 * cov.norm()));
    EXPECT_EQ(pose->stamp, sample.stamp);
  }
}

}  // namespace
}  // namespace shiftmap::live

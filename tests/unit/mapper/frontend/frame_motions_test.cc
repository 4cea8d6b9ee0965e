// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/frame_motions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "mapper/frontend/smooth_odometry.h"
#include "tests/unit/mapper/mapper_test_util.h"
#include "tools/sim/random.h"

namespace shiftmap {
namespace {

OdometryCalibration Scaled(double log_scale_v, double log_scale_omega, double lag_s) {
  OdometryCalibration calibration;
  calibration.scale_v = std::exp(log_scale_v);
  calibration.scale_omega = std::exp(log_scale_omega);
  calibration.lag_s = lag_s;
  return calibration;
}

MappingRun SomeRun() {
  OpenWorldOptions options = testing::SmallWorld(2);
  options.runs = 1;
  const SimulatedWorld world = testing::Simulate(options);
  return testing::Arrange(world, world.runs[0].run);
}

TEST(FrameMotions, AreIntegratedAgainWhereTheCalibrationIsElsewhere) {
  const MappingRun run = SomeRun();
  FrameMotions motions;
  UpdateMotions(run, Scaled(0.0, 0.0, 0.0), &motions);
  ASSERT_EQ(motions.between_frames.size() + 1, run.frames.size());
  UpdateMotions(run, Scaled(0.009, 0.0, 0.0), &motions);
  EXPECT_EQ(motions.calibration.scale_v, 1.0);
  UpdateMotions(run, Scaled(0.0, 0.011, 0.0), &motions);
  EXPECT_EQ(motions.calibration.scale_omega, std::exp(0.011));
  EXPECT_EQ(motions.between_frames.size() + 1, run.frames.size());
}

TEST(FrameMotions, BrokenOnesTellNothingAndStayBroken) {
  const MappingRun run = SomeRun();
  FrameMotions motions = IntegrateMotions(run, {});
  EXPECT_TRUE(BrokenMotions(motions).empty());
  BreakMotion(7, &motions);
  UpdateMotions(run, Scaled(0.1, 0.0, 0.0), &motions);
  ASSERT_EQ(motions.calibration.scale_v, std::exp(0.1));
  EXPECT_EQ(BrokenMotions(motions), std::vector<FrameIndex>{7});
  const Eigen::Vector3d variances = MotionFrom(motions, 7, {}).cov.diagonal();
  EXPECT_GT(variances.head<2>().minCoeff(), 1e6);  // A kilometre.
  EXPECT_GT(variances.z(), 1e2);                   // Any heading.
}

TEST(FrameMotions, AreLinearNearby) {
  const MappingRun run = SomeRun();
  const OdometryCalibration near = Scaled(0.008, -0.006, 0.0);
  const FrameMotions linear = IntegrateMotions(run, Scaled(0.0, 0.0, 0.0));
  const FrameMotions integrated = IntegrateMotions(run, near);
  for (const FrameIndex i : linear.between_frames.indices()) {
    const Se2 T_linear = MotionFrom(linear, i, near).T_begin_end;
    const Se2 T_integrated = integrated.between_frames[i].T_begin_end;
    EXPECT_LT((T_linear.Inverse() * T_integrated).Log().norm(), 5e-4) << i.value();
    EXPECT_EQ(MotionFrom(integrated, i, near).T_begin_end.translation(),
              T_integrated.translation());
  }
}

// Where odometry has no noise.
TEST(FrameMotions, AreLinearInTheLagNearby) {
  const MappingRun run = SomeRun();
  constexpr double kLag = 0.05;  // Half a sample.
  const FrameMotions motions = IntegrateMotions(run, Scaled(0.05, 0.02, 0.0));
  const FrameMotions sooner = IntegrateMotions(run, Scaled(0.05, 0.02, -kLag));
  const FrameMotions later = IntegrateMotions(run, Scaled(0.05, 0.02, kLag));
  double largest = 0.0;
  for (const FrameIndex i : motions.between_frames.indices()) {
    const Se2 T_change =
        sooner.between_frames[i].T_begin_end.Inverse() * later.between_frames[i].T_begin_end;
    const Eigen::Vector3d by_lag = motions.between_frames[i].J_calibration.col(2);
    EXPECT_LT((T_change.Log() - 2.0 * kLag * by_lag).norm(), 1e-3) << i.value();
    largest = std::max(largest, by_lag.norm());
  }
  EXPECT_GT(largest, 0.2);
}

TEST(FrameMotions, NoiseOfSamplesTellsNothingOfTheLag) {
  MappingRun run = SomeRun();
  Random random = MakeRandom(1, 1);
  for (OdometrySample& sample : run.odometry) {
    sample.v_mps = 1.0 + Gaussian(0.1, &random);
    sample.omega_radps = 0.2 + Gaussian(0.05, &random);
  }
  run.smooth_odometry = SmoothOdometry(run.odometry);
  for (const IntegratedMotion& motion : IntegrateMotions(run, {}).between_frames) {
    EXPECT_LT(motion.J_calibration.col(2).norm(), 0.01);
  }
}

TEST(FrameMotions, DeadReckoningPutsThemTogether) {
  const MappingRun run = SomeRun();
  const FrameMotions motions = IntegrateMotions(run, {});
  const IndexedVector<FrameIndex, Se2> poses = DeadReckon(motions);
  ASSERT_EQ(poses.size(), run.frames.size());
  EXPECT_EQ(poses.front().translation(), Eigen::Vector2d::Zero());
  const FrameIndex middle(poses.size() / 2);
  const Se2 T_middle_next = poses[middle].Inverse() * poses[middle + 1];
  const Se2& expected = motions.between_frames[middle].T_begin_end;
  EXPECT_LT((T_middle_next.Inverse() * expected).Log().norm(), 1e-12);
}

}  // namespace
}  // namespace shiftmap

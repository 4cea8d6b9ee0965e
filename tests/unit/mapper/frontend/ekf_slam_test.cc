// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/ekf_slam.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "localizer/models/motion_model.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

std::vector<Se2> Estimate(const MappingRun& run, const Calibration& calibration) {
  return EstimateTrajectoryByEkf(run, IntegrateMotions(run, calibration.odometry), calibration);
}

TEST(EkfSlam, FollowsTheTruthWhereDeadReckoningDrifts) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    OpenWorldOptions options = testing::SmallWorld(seed);
    options.runs = 1;
    options.duration_s = 240.0;
    options.odometry.scale_v = 1.04;
    options.odometry.scale_omega = 0.97;
    options.odometry.noise_omega = 0.03;
    const SimulatedWorld world = testing::Simulate(options);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const Calibration calibration{{.noise_v = 0.01, .noise_omega = 0.03}, options.sensor};
    const std::vector<Se2> poses = Estimate(run, calibration);
    ASSERT_EQ(poses.size(), run.frames.size());
    EXPECT_EQ(poses.front().translation(), Eigen::Vector2d::Zero());
    const std::vector<Se2> truth = testing::TruePoses(world.runs[0], run);
    const double error = testing::AlignedRmse(poses, truth);
    const double drift =
        testing::AlignedRmse(DeadReckon(IntegrateMotions(run, calibration.odometry)), truth);
    EXPECT_LT(error, 0.25) << seed;
    EXPECT_LT(error, 0.5 * drift) << seed;
  }
}

// The poses of a filter jump whenever it sees something: ten times as far as odometry can be wrong.
TEST(EkfSlam, PosesGoAsOdometryDoes) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    OpenWorldOptions options = testing::SmallWorld(seed);
    options.runs = 1;
    const SimulatedWorld world = testing::Simulate(options);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const Calibration calibration{options.odometry, options.sensor};
    const FrameMotions motions = IntegrateMotions(run, calibration.odometry);
    const IndexedVector<FrameIndex, Se2> poses = EstimateTrajectoryByEkf(run, motions, calibration);
    double squares = 0.0;
    for (FrameIndex i; i + 1 < poses.end_index(); ++i) {
      const MotionIncrement motion = MotionFrom(motions, i, calibration.odometry);
      const Eigen::Vector3d error =
          (motion.T_begin_end.Inverse() * poses[i].Inverse() * poses[i + 1]).Log();
      squares += error.dot(motion.cov.inverse() * error);
    }
    EXPECT_LT(squares / (3.0 * static_cast<double>(poses.size())), 3.0) << seed;
  }
}

TEST(EkfSlam, MisreadSignaturesDoNotPullItAway) {
  OpenWorldOptions options = testing::SmallWorld(6);
  options.runs = 1;
  options.clutter_per_scan = 0.1;
  const SimulatedWorld world = testing::Simulate(options);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const Calibration calibration{{.noise_v = 0.01, .noise_omega = 0.01}, options.sensor};
  const double error =
      testing::AlignedRmse(Estimate(run, calibration), testing::TruePoses(world.runs[0], run));
  EXPECT_LT(error, 0.25);
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "tools/eval/trajectory_error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/geometry_matchers.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

std::vector<StampedPose> Circle(int poses) {
  std::vector<StampedPose> trajectory;
  Se2 pose(4.0, 1.0, 0.3);
  for (int i = 0; i < poses; ++i) {
    trajectory.push_back({StampFromSeconds(100.0 + 0.1 * i), pose});
    pose = pose * Se2::Exp({0.1, 0.0, 0.02});
  }
  return trajectory;
}

TEST(TrajectoryError, OfTheTruthItselfIsZero) {
  const auto error = EvaluateTrajectory(Circle(50), Circle(50), {});
  ASSERT_THAT(error, IsOk());
  EXPECT_EQ(error->matched, 50);
  EXPECT_EQ(error->unmatched, 0);
  EXPECT_NEAR(error->position_max_m, 0.0, 1e-12);
  EXPECT_NEAR(error->yaw_rmse_rad, 0.0, 1e-12);
}

TEST(TrajectoryError, OfAConstantOffsetIsTheOffset) {
  std::vector<StampedPose> estimate = Circle(50);
  for (StampedPose& pose : estimate) {
    const Se2& T = pose.T_map_vehicle;
    pose.T_map_vehicle = Se2(T.x() + 0.3, T.y() + 0.4, T.yaw() - 0.2);
  }
  const auto error = EvaluateTrajectory(estimate, Circle(50), {});
  ASSERT_THAT(error, IsOk());
  EXPECT_NEAR(error->position_rmse_m, 0.5, 1e-9);
  EXPECT_NEAR(error->position_mean_m, 0.5, 1e-9);
  EXPECT_NEAR(error->position_median_m, 0.5, 1e-9);
  EXPECT_NEAR(error->position_p95_m, 0.5, 1e-9);
  EXPECT_NEAR(error->yaw_rmse_rad, 0.2, 1e-9);
}

TEST(TrajectoryError, AlignmentUndoesAnotherFrame) {
  const Se2 T_truth_estimate(10.0, -20.0, 2.5);
  std::vector<StampedPose> estimate = Circle(50);
  for (StampedPose& pose : estimate) {
    pose.T_map_vehicle = T_truth_estimate.Inverse() * pose.T_map_vehicle;
  }
  const auto error = EvaluateTrajectory(estimate, Circle(50), {.align = true});
  ASSERT_THAT(error, IsOk());
  EXPECT_NEAR(error->position_max_m, 0.0, 1e-9);
  EXPECT_NEAR(error->yaw_rmse_rad, 0.0, 1e-9);
  EXPECT_THAT(error->T_truth_estimate, testing::IsNearPose(T_truth_estimate, 1e-9));
}

TEST(TrajectoryError, CountsWhatTheTruthDoesNotCover) {
  const std::vector<StampedPose> truth = Circle(50);
  const auto error =
      EvaluateTrajectory(Circle(60), std::vector<StampedPose>(truth.begin(), truth.end()), {});
  ASSERT_THAT(error, IsOk());
  EXPECT_EQ(error->matched, 50);
  EXPECT_EQ(error->unmatched, 10);
  EXPECT_THAT(EvaluateTrajectory(Circle(3), {}, {}),
              StatusIs(StatusCode::kInvalidArgument, "no pose matches"));
}

}  // namespace
}  // namespace shiftmap

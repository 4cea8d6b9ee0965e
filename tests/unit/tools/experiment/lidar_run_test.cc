// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/lidar_run.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tests/support/ray_caster.h"
#include "tools/eval/trajectory_error.h"
#include "tools/experiment/pose_relations.h"

namespace shiftmap {
namespace {

// Four rounds in a hall with boxes of several sizes, scans of 361 beams every second; odometry is
// 3 % wrong in turns and noisy.
struct Hall {
  LidarLog log;
  std::vector<StampedPose> truth;
};

Hall DriveAround() {
  std::vector<Wall> walls = WallsAlong({{0.0, 0.0}, {16.0, 0.0}, {16.0, 12.0}, {0.0, 12.0}}, true);
  const auto add_box = [&](double x, double y, double width, double depth) {
    const std::vector<Eigen::Vector2d> box = {
        {x, y}, {x + width, y}, {x + width, y + depth}, {x, y + depth}};
    for (const Wall& wall : WallsAlong(box, true)) walls.push_back(wall);
  };
  add_box(6.0, 5.0, 4.0, 2.0);
  add_box(0.0, 4.0, 1.0, 1.5);
  add_box(4.0, 11.0, 2.0, 1.0);
  add_box(10.5, 10.8, 1.0, 1.2);
  add_box(15.0, 7.0, 1.0, 0.8);
  add_box(14.8, 3.0, 1.2, 1.0);
  add_box(8.0, 0.0, 1.5, 0.9);
  add_box(3.0, 0.0, 0.8, 1.1);
  Hall hall;
  hall.log.name = "hall";
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  const LidarSensor sensor;
  const auto at = [](int i) {
    const double angle = 2.0 * std::numbers::pi * i / 60.0;
    return Se2(8.0 + 5.0 * std::cos(angle),
               6.0 + 3.5 * std::sin(angle),
               std::atan2(3.5 * std::cos(angle), -5.0 * std::sin(angle)));
  };
  Se2 T_odom_vehicle;
  for (int i = 0; i < 240; ++i) {
    const Stamp stamp = StampFromSeconds(1000.0 + i);
    if (i > 0) {
      Eigen::Vector3d twist = (at(i - 1).Inverse() * at(i)).Log();
      twist.z() *= 1.03;
      twist += Eigen::Vector3d(0.01 * normal(random), 0.0, 0.02 * normal(random));
      T_odom_vehicle = T_odom_vehicle * Se2::Exp(twist);
    }
    hall.truth.push_back({stamp, at(i)});
    hall.log.poses.push_back({stamp, T_odom_vehicle});
    std::vector<double> ranges = CastScan(walls, at(i), 361, sensor);
    for (double& range : ranges) range += 0.01 * normal(random);
    hall.log.scans.push_back({stamp, ranges});
  }
  return hall;
}

TEST(LidarRun, MapsAHallByItsCorners) {
  const Hall hall = DriveAround();
  const LidarFrontEndOptions front_end;
  const auto run = MakeLidarRun(hall.log, "robot", front_end);
  ASSERT_TRUE(run.ok()) << Message(run.status());
  const auto results = MapLidarRun(*run, IndoorOptions());
  ASSERT_TRUE(results.ok()) << Message(results.status());
  ASSERT_EQ(results->size(), 4U);
  const auto rmse = [&](const ParkResult& result) {
    return EvaluateTrajectory(result.trajectory, hall.truth, {.align = true, .max_gap_s = 1.0})
        ->position_rmse_m;
  };
  RecordProperty("rmse_m", std::to_string(rmse(results->back())));
  EXPECT_GT(rmse(results->front()), 0.5);
  EXPECT_LT(rmse(results->back()), 0.08);
  EXPECT_GT(results->back().landmarks.size(), 20U);
  // The truth fits itself, and what was mapped nearly as well; dead reckoning does not.
  const RevisitMisfit truth = MeasureRevisits(hall.log, hall.truth, front_end);
  const RevisitMisfit mapped = MeasureRevisits(hall.log, results->back().trajectory, front_end);
  const RevisitMisfit reckoned = MeasureRevisits(hall.log, results->front().trajectory, front_end);
  EXPECT_GT(truth.pairs, 100);
  EXPECT_GT(mapped.pairs, 100);
  EXPECT_LT(truth.median_m, 0.05);
  EXPECT_LT(mapped.median_m, 0.08);
  EXPECT_GT(reckoned.median_m, 2.0 * mapped.median_m);
}

TEST(LidarRun, SimulatedOdometryHasTheNoiseAskedFor) {
  std::vector<StampedPose> truth;
  for (int i = 0; i <= 4000; ++i) {
    truth.push_back({StampFromSeconds(4.0 * i), Se2(0.3 * i, 0.1 * i, 0.2 * i)});
  }
  OdometryCalibration noise;
  noise.noise_v = 0.03;
  noise.noise_omega = 0.02;
  const std::vector<StampedPose> odometry = SimulateOdometry(truth, noise, 1);
  const auto error = EvaluateRelations(odometry, RelationsAlong(truth, 1));
  ASSERT_TRUE(error.ok());
  EXPECT_EQ(error->matched, 4000);
  // Over four seconds, along and across.
  EXPECT_NEAR(error->translation_mean_square_m2, 2.0 * 4.0 * 0.0009, 0.0003);
  EXPECT_NEAR(error->rotation_mean_square_rad2, 4.0 * 0.0004, 0.0001);
}

TEST(LidarRun, DrawsWallsLandmarksAndPath) {
  const Hall hall = DriveAround();
  const ParkResult result{.method = "truth", .trajectory = hall.truth, .landmarks = {{1.0, 2.0}}};
  const Chart chart = DrawLidarMap(hall.log, result, {});
  ASSERT_EQ(chart.series.size(), 3U);
  EXPECT_EQ(chart.title, "hall: truth");
  EXPECT_EQ(chart.series[0].points.size(), 1U);
  EXPECT_EQ(chart.series[1].points.size(), 80U);
  EXPECT_GT(chart.series[2].points.size(), 1000U);
  for (const Eigen::Vector2d& p : chart.series[2].points) {
    EXPECT_TRUE(p.x() > -0.1 && p.x() < 16.1 && p.y() > -0.1 && p.y() < 12.1);
  }
}

}  // namespace
}  // namespace shiftmap

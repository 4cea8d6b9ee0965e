// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/lidar_log.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "mapstore/codec/run_log.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

// Drives what the samples say, arc by arc, up to `end`.
Se2 Drive(const std::vector<OdometrySample>& samples, Stamp end) {
  Se2 pose;
  for (std::size_t i = 0; i < samples.size() && samples[i].stamp < end; ++i) {
    const Stamp until = i + 1 < samples.size() ? std::min(samples[i + 1].stamp, end) : end;
    const double seconds = ToSeconds(until - samples[i].stamp);
    pose = pose * Se2::Exp({samples[i].v_mps * seconds, 0.0, samples[i].omega_radps * seconds});
  }
  return pose;
}

// How far what the samples lead to is from a pose.
Eigen::Vector3d ErrorAt(const StampedPose& pose,
                        const std::vector<StampedPose>& poses,
                        const std::vector<OdometrySample>& samples) {
  const Se2 T_start_odom = poses.front().T_map_vehicle.Inverse();
  return (Drive(samples, pose.stamp).Inverse() * (T_start_odom * pose.T_map_vehicle)).Log();
}

void ExpectOrderAndLimits(const std::vector<OdometrySample>& samples) {
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (i > 0) {
      EXPECT_LE(samples[i - 1].stamp, samples[i].stamp);
    }
    EXPECT_LE(std::abs(samples[i].v_mps), 90.0 + 1e-9);
    EXPECT_LE(std::abs(samples[i].omega_radps), 45.0 + 1e-9);
  }
}

TEST(OdometryFromPoses, LeadsFromPoseToPose) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<StampedPose> poses = {{StampFromSeconds(100.0), Se2(5.0, -3.0, 2.0)}};
  for (int i = 0; i < 300; ++i) {
    // Forwards and backwards, now and then on the spot, for a while, or sliding.
    const StampedPose& last = poses.back();
    const double seconds = i % 20 == 0 ? 14.0 : 1.0 + 0.4 * uniform(random);
    const double along = (i % 2 == 0 ? 1.0 : -1.0) * (0.6 + 0.2 * uniform(random));
    poses.push_back({last.stamp + FromSeconds(seconds),
                     last.T_map_vehicle * Se2::Exp({i % 7 == 0 ? 0.0 : along,
                                                    i % 3 == 0 ? 0.02 * uniform(random) : 0.0,
                                                    i % 5 == 0 ? 0.0 : uniform(random)})});
  }
  const auto samples = OdometryFromPoses(poses);
  ExpectOrderAndLimits(samples);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    // On the spot it cannot slide.
    const bool turned = i > 0 && (i - 1) % 7 == 0;
    EXPECT_LT(ErrorAt(poses[i], poses, samples).norm(), turned ? 0.03 : 1e-6) << i;
    EXPECT_NEAR(ErrorAt(poses[i], poses, samples).z(), 0.0, 1e-6) << i;
  }
}

TEST(OdometryFromPoses, MakesGoodLaterWhatNoVehicleDoesInTheTime) {
  const std::vector<StampedPose> poses = {{StampFromSeconds(0.0), Se2()},
                                          {StampFromSeconds(0.005), Se2(1.0, 0.0, 0.5)},
                                          {StampFromSeconds(2.0), Se2(1.0, 0.0, 0.5)}};
  const auto samples = OdometryFromPoses(poses);
  ExpectOrderAndLimits(samples);
  EXPECT_GT(ErrorAt(poses[1], poses, samples).norm(), 0.5);
  EXPECT_LT(ErrorAt(poses[2], poses, samples).norm(), 1e-6);
}

TEST(OdometryFromPoses, HoldsNoSampleLongerThanItCounts) {
  const std::vector<StampedPose> poses = {{StampFromSeconds(0.0), Se2()},
                                          {StampFromSeconds(14.0), Se2(1.4, 0.0, 0.0)},
                                          {StampFromSeconds(1e6), Se2(2.4, 0.0, 0.0)}};
  const auto samples = OdometryFromPoses(poses);
  EXPECT_LT(samples.size(), 80U);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    if (samples[i - 1].v_mps == 0.0) continue;
    EXPECT_LE(ToSeconds(samples[i].stamp - samples[i - 1].stamp), 2.0);
  }
  EXPECT_NEAR(samples.front().v_mps, 0.1, 1e-12);
  ExpectOrderAndLimits(samples);
  EXPECT_LT(ErrorAt(poses[1], poses, samples).norm(), 1e-6);
  EXPECT_LT(ErrorAt(poses[2], poses, samples).norm(), 1e-6);
}

TEST(OdometryFromPoses, TakesTheLastOfPosesOfOneTime) {
  const Stamp one = StampFromSeconds(1.0);
  const auto samples = OdometryFromPoses(std::vector<StampedPose>{
      {StampFromSeconds(0.0), Se2()}, {one, Se2(5.0, 0.0, 0.0)}, {one, Se2(1.0, 0.0, 0.0)}});
  EXPECT_LT((Drive(samples, one).translation() - Eigen::Vector2d(1.0, 0.0)).norm(), 1e-9);
  EXPECT_TRUE(OdometryFromPoses({}).empty());
}

TEST(MakeLidarRun, SurvivesTheRunLog) {
  LidarLog log;
  log.name = "hall.json";
  for (int i = 0; i < 5; ++i) {
    const Stamp stamp = StampFromSeconds(1000.0 + i);
    log.poses.push_back({stamp, Se2(0.1 * i, 0.0, 0.02 * i)});
    // A corner ahead, 3 m away.
    RangeScan scan{stamp, {}};
    for (int beam = 0; beam < 181; ++beam) {
      const double bearing = std::abs(static_cast<double>(beam) - 90.0) * 0.017453292519943295;
      scan.ranges_m.push_back(std::min(81.0, 3.0 / (std::cos(bearing) + std::sin(bearing))));
    }
    log.scans.push_back(scan);
  }
  const auto run = MakeLidarRun(log, "cart", {});
  ASSERT_TRUE(run.ok()) << Message(run.status());
  EXPECT_EQ(run->info.vehicle, "cart");
  EXPECT_EQ(run->info.source, "hall.json");
  const testing::TempDir folder;
  const std::string path = folder.File("run.mcap");
  ASSERT_TRUE(WriteRunLog(*run, path).ok());
  const auto read = ReadRunLog(path);
  ASSERT_TRUE(read.ok()) << Message(read.status());
  ASSERT_EQ(read->run.scans.size(), 5U);
  EXPECT_EQ(read->run.odometry.size(), run->odometry.size());
  for (std::size_t i = 0; i < 5; ++i) {
    const Scan& scan = read->run.scans[i];
    EXPECT_EQ(scan.stamp, log.scans[i].stamp);
    ASSERT_EQ(scan.observations.size(), 1U);
    EXPECT_EQ(scan.observations[0].z, run->scans[i].observations[0].z);
    EXPECT_EQ(scan.observations[0].cov_z, run->scans[i].observations[0].cov_z);
    EXPECT_LT((scan.observations[0].z - Eigen::Vector2d(3.0, 0.0)).norm(), 0.05);
  }
  EXPECT_TRUE(read->run.lidar_scans.empty());
}

// To the millimetre, without what is no return, and beside the same landmarks.
TEST(MakeLidarRun, KeepsScansWhereAsked) {
  LidarLog log;
  for (int i = 0; i < 3; ++i) {
    const Stamp stamp = StampFromSeconds(1000.0 + i);
    log.poses.push_back({stamp, Se2()});
    log.scans.push_back({stamp, {1.2344, -1.0, 81.0, std::nan(""), 2.0 + i}});
  }
  LidarFrontEndOptions options;
  options.sensor.T_vehicle_lidar = Se2(0.3, 0.1, 0.2);
  const auto run = MakeLidarRun(log, "cart", options, true);
  ASSERT_TRUE(run.ok()) << Message(run.status());
  const testing::TempDir folder;
  const std::string path = folder.File("run.mcap");
  ASSERT_TRUE(WriteRunLog(*run, path).ok());
  const auto read = ReadRunLog(path);
  ASSERT_TRUE(read.ok()) << Message(read.status());
  EXPECT_EQ(read->run.scans.size(), 3U);
  ASSERT_EQ(read->run.lidar_scans.size(), 3U);
  for (int i = 0; i < 3; ++i) {
    const LidarScan& scan = read->run.lidar_scans[static_cast<std::size_t>(i)];
    EXPECT_EQ(scan.stamp, StampFromSeconds(1000.0 + i));
    EXPECT_EQ(scan.ranges_m, (std::vector{1.234f, 0.0f, 0.0f, 0.0f, 2.0f + static_cast<float>(i)}));
    EXPECT_EQ(scan.sensor.max_range_m, 80.0);
    EXPECT_EQ(scan.sensor.T_vehicle_lidar.x(), 0.3);
  }
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
//
// A vehicle drives past a wall with a door, and a landmark stands behind the wall: not in view
// until the door is abeam. Lidar scans and sightings are those of the walls.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "localizer/localizer.h"
#include "tests/support/ray_caster.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

constexpr double kSpeed = 0.25;   // [m/s]
constexpr double kPeriod = 0.25;  // Of scans, of either kind. [s]
constexpr double kDoorS = 14.8;   // When the landmark comes into view.
constexpr double kEndS = 26.0;
const Se2 kLidar(0.3, 0.0, 0.1);  // On the vehicle.
const Se2 kStart(-3.0, -3.0, 0.5 * std::numbers::pi);
const Signature kBehind("100");

std::vector<Wall> Walls() {
  std::vector<Wall> walls = WallsAlong({{-6.0, -4.0}, {6.0, -4.0}, {6.0, 4.0}, {-6.0, 4.0}}, true);
  walls.push_back({{0.0, -4.0}, {0.0, 1.0}});
  return walls;
}

MapContent Map() {
  const std::vector<Eigen::Vector2d> places = {
      {3.0, 1.0}, {-0.3, -2.5}, {-0.3, -0.5}, {-5.7, -1.5}, {-5.7, 2.0}, {-1.0, 3.8}};
  MapContent content = MakeTwoModeMap(static_cast<int>(places.size()), 10.0, 1);
  std::vector<Eigen::Matrix2d> marginals;
  for (std::size_t i = 0; i < places.size(); ++i) {
    LandmarkGroup& group = content.groups[i];
    group.modes.resize(1);
    group.modes[0].p_map_landmark = places[i];
    group.chain = ModeChain::Uniform(1, 1e-6);
    group.probabilities = Eigen::Vector2d(0.05, 0.95);
    marginals.push_back(group.modes[0].cov_p_map_landmark);
  }
  content.covariance = JointCovariance(marginals, {});
  content.calibration.sensor.max_range_m = 9.0;
  content.calibration.sensor.max_bearing_rad = std::numbers::pi;
  return content;
}

bool IsFree(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  const auto side =
      [](const Eigen::Vector2d& p, const Eigen::Vector2d& q, const Eigen::Vector2d& r) {
        return (q - p).x() * (r - p).y() - (q - p).y() * (r - p).x();
      };
  const std::vector<Wall> walls = Walls();
  return std::none_of(walls.begin(), walls.end(), [&](const Wall& wall) {
    return side(a, b, wall.a) * side(a, b, wall.b) < 0.0 &&
           side(wall.a, wall.b, a) * side(wall.a, wall.b, b) < 0.0;
  });
}

LidarScan LidarAt(const Se2& T_map_vehicle, Stamp stamp) {
  LidarScan scan;
  scan.stamp = stamp;
  scan.sensor.field_of_view_rad = 2.0 * std::numbers::pi * 359.0 / 360.0;
  scan.sensor.T_vehicle_lidar = kLidar;
  const auto ranges =
      CastScan(Walls(), T_map_vehicle * scan.sensor.T_vehicle_lidar, 360, scan.sensor);
  scan.ranges_m.assign(ranges.begin(), ranges.end());
  return scan;
}

// @param lidar_delay_s  Of the lidar's stamps before those of the landmarks; nothing: no lidar.
Run Drive(const MapContent& content, std::optional<double> lidar_delay_s) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  const SensorCalibration& sensor = content.calibration.sensor;
  Run run;
  for (double t = 0.0; t <= kEndS; t += kPeriod) {
    const Stamp stamp = StampFromSeconds(1000.0 + t);
    const Se2 T_map_vehicle = kStart * Se2(kSpeed * t, 0.0, 0.0);
    run.odometry.push_back({stamp, kSpeed, 0.0});
    if (lidar_delay_s) {
      run.lidar_scans.push_back(LidarAt(T_map_vehicle, stamp - FromSeconds(*lidar_delay_s)));
    }
    Scan& scan = run.scans.emplace_back();
    scan.stamp = stamp;
    for (const LandmarkGroup& group : content.groups) {
      const Eigen::Vector2d& p = group.modes[0].p_map_landmark;
      if (!IsFree(T_map_vehicle * kLidar.translation(), p)) continue;
      const Eigen::Vector2d q = T_map_vehicle.Inverse() * p;
      Observation& observation = scan.observations.emplace_back();
      observation.signature = group.signature;
      observation.z = {q.norm() + sensor.sd_range_m * normal(random),
                       std::atan2(q.y(), q.x()) + sensor.sd_bearing_rad * normal(random)};
    }
  }
  return run;
}

struct Outcome {
  double absent_before_door = 0.0;  // Of the landmark behind the wall.
  double absent_at_end = 0.0;
  std::vector<PoseEstimate> poses;
  LocalizerStatistics statistics;
};

Outcome Localize(const MapContent& content, const Run& run, FieldOfViewModel model) {
  LocalizerOptions options;
  options.hypotheses.field_of_view.model = model;
  options.initial_pose = PoseWithCovariance{kStart, Eigen::Vector3d(1e-3, 1e-3, 1e-4).asDiagonal()};
  Localizer localizer(Snapshot(content), options);
  const int group = localizer.snapshot().GroupIndex(kBehind);
  Outcome outcome;
  for (const RunEvent& event : MergeEvents(run)) {
    EXPECT_TRUE(localizer.Process(event).ok());
    outcome.poses.insert(
        outcome.poses.end(), localizer.new_estimates().begin(), localizer.new_estimates().end());
    if (StampOf(event) < StampFromSeconds(1000.0 + kDoorS - 2.0)) {
      outcome.absent_before_door = localizer.Probabilities(group)[0];
    }
  }
  outcome.absent_at_end = localizer.Probabilities(group)[0];
  outcome.statistics = localizer.Statistics();
  return outcome;
}

TEST(Occlusion, SilenceFromBehindAWallSpeaksOnlyInTheSector) {
  const MapContent content = Map();
  const shiftmap::Run run = Drive(content, 0.0);
  const bool seen_before = std::any_of(run.scans.begin(), run.scans.end(), [](const Scan& scan) {
    return scan.stamp < StampFromSeconds(1000.0 + kDoorS) &&
           std::any_of(scan.observations.begin(), scan.observations.end(), [](const auto& seen) {
             return seen.signature == kBehind;
           });
  });
  ASSERT_FALSE(seen_before);
  const Outcome sector = Localize(content, run, FieldOfViewModel::kSector);
  const Outcome polygon = Localize(content, run, FieldOfViewModel::kScanPolygon);
  // Up to what an occlusion allows.
  const double prior = content.groups[0].probabilities[0];
  const double occluded = content.calibration.sensor.occluded_visit_probability;
  EXPECT_NEAR(sector.absent_before_door, prior / (prior + (1.0 - prior) * occluded), 0.02);
  EXPECT_NEAR(polygon.absent_before_door, prior, 1e-3);
  // Seen through the door.
  EXPECT_LT(sector.absent_at_end, 1e-3);
  EXPECT_LT(polygon.absent_at_end, 1e-3);
  EXPECT_EQ(sector.statistics.scans_by_lidar, 0);
  EXPECT_EQ(polygon.statistics.scans_by_lidar, polygon.statistics.scans);
}

// A lidar of its own pace: scans of some time ago count as well, up to their largest age.
TEST(Occlusion, AScanOfSomeTimeAgoCounts) {
  const MapContent content = Map();
  const double prior = content.groups[0].probabilities[0];
  const auto polygon = FieldOfViewModel::kScanPolygon;
  EXPECT_NEAR(Localize(content, Drive(content, 0.11), polygon).absent_before_door, prior, 1e-3);
  EXPECT_GT(Localize(content, Drive(content, 0.6), polygon).statistics.scans_by_lidar, 0);
}

TEST(Occlusion, WithoutLidarScansBothModelsAreOne) {
  const MapContent content = Map();
  const shiftmap::Run run = Drive(content, std::nullopt);
  const Outcome sector = Localize(content, run, FieldOfViewModel::kSector);
  const Outcome polygon = Localize(content, run, FieldOfViewModel::kScanPolygon);
  EXPECT_EQ(polygon.statistics.scans_by_lidar, 0);
  EXPECT_EQ(polygon.absent_before_door, sector.absent_before_door);
  EXPECT_EQ(polygon.absent_at_end, sector.absent_at_end);
  ASSERT_EQ(polygon.poses.size(), sector.poses.size());
  for (std::size_t i = 0; i < sector.poses.size(); ++i) {
    EXPECT_EQ(polygon.poses[i].pose.T_map_vehicle.translation(),
              sector.poses[i].pose.T_map_vehicle.translation());
    EXPECT_EQ(polygon.poses[i].pose.cov_T_map_vehicle, sector.poses[i].pose.cov_T_map_vehicle);
  }
}

// In the sector a lidar's scans change nothing, whether the log has them or not.
TEST(Occlusion, TheSectorDoesWithoutLidarScans) {
  const MapContent content = Map();
  const Outcome without =
      Localize(content, Drive(content, std::nullopt), FieldOfViewModel::kSector);
  const Outcome with = Localize(content, Drive(content, 0.05), FieldOfViewModel::kSector);
  ASSERT_EQ(with.poses.size(), without.poses.size());
  for (std::size_t i = 0; i < with.poses.size(); ++i) {
    EXPECT_EQ(with.poses[i].stamp, without.poses[i].stamp);
    EXPECT_EQ(with.poses[i].pose.cov_T_map_vehicle, without.poses[i].pose.cov_T_map_vehicle);
  }
  EXPECT_EQ(with.absent_at_end, without.absent_at_end);
}

}  // namespace
}  // namespace shiftmap

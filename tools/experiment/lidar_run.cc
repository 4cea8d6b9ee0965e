// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/lidar_run.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "mapstore/core/median.h"
#include "tools/experiment/dice.h"

namespace shiftmap {
namespace {

constexpr double kRevisitWithin = 2.0;  // [m]
constexpr double kRevisitTurned = 0.5;  // [rad]
constexpr Duration kRevisitAfter = std::chrono::minutes(1);

// Of the scans, of the beams: as many as tell.
constexpr std::size_t kEveryScan = 3;
constexpr std::size_t kEveryBeam = 5;

// What a scan hit, where the trajectory has it; nothing for a scan that it has no pose for.
struct PlacedScan {
  Stamp stamp;
  Se2 T_map_vehicle;
  std::vector<Eigen::Vector2d> p_map;
};

std::vector<PlacedScan> PlaceScans(const LidarLog& log,
                                   std::span<const StampedPose> trajectory,
                                   const LidarFrontEndOptions& options) {
  std::vector<PlacedScan> placed;
  auto pose = trajectory.begin();
  for (const RangeScan& scan : log.scans) {
    while (pose != trajectory.end() && pose->stamp < scan.stamp) ++pose;
    if (pose == trajectory.end()) break;
    if (pose->stamp != scan.stamp) continue;
    PlacedScan& out = placed.emplace_back(PlacedScan{scan.stamp, pose->T_map_vehicle, {}});
    const Se2 T_map_lidar = pose->T_map_vehicle * options.sensor.T_vehicle_lidar;
    for (const ScanPoint& point : ScanPoints(scan.ranges_m, options.sensor)) {
      if (point.range_m > options.max_point_range_m) continue;
      out.p_map.push_back(T_map_lidar * point.p_lidar);
    }
  }
  return placed;
}

}  // namespace

MapperOptions IndoorOptions() {
  MapperOptions options;
  options.association.associate = true;
  options.association.separation_m = 0.3;
  options.association.duplicate_distance_m = 0.3;
  options.association.confirm_sightings = 3;
  options.association.min_sightings = 4;
  options.calibration.odometry.noise_v = 0.07;
  options.calibration.odometry.noise_omega = 0.05;
  return options;
}

std::vector<StampedPose> SimulateOdometry(std::span<const StampedPose> trajectory,
                                          const OdometryCalibration& noise,
                                          std::uint64_t seed) {
  Dice dice(seed);
  std::vector<StampedPose> odometry;
  for (std::size_t i = 0; i < trajectory.size(); ++i) {
    if (i == 0) {
      odometry.push_back(trajectory[0]);
      continue;
    }
    const double root = std::sqrt(ToSeconds(trajectory[i].stamp - trajectory[i - 1].stamp));
    const Eigen::Vector2d slip = noise.noise_v * root * dice.Normal2();
    const Eigen::Vector3d error(slip.x(), slip.y(), noise.noise_omega * root * dice.Normal());
    const Se2 step = trajectory[i - 1].T_map_vehicle.Inverse() * trajectory[i].T_map_vehicle;
    odometry.push_back(
        {trajectory[i].stamp, odometry.back().T_map_vehicle * step * Se2::Exp(error)});
  }
  return odometry;
}

StatusOr<std::vector<ParkResult>> MapLidarRun(const Run& run, const MapperOptions& options) {
  std::vector<ParkResult> results = {RunDeadReckoning(run, options.calibration),
                                     RunFilter(run, options, false),
                                     RunFilter(run, options, true)};
  SHIFTMAP_ASSIGN_OR_RETURN(ParkResult mapped, RunMapper(run, options));
  results.push_back(std::move(mapped));
  return results;
}

RevisitMisfit MeasureRevisits(const LidarLog& log,
                              std::span<const StampedPose> trajectory,
                              const LidarFrontEndOptions& options) {
  const std::vector<PlacedScan> scans = PlaceScans(log, trajectory, options);
  RevisitMisfit misfit;
  std::vector<double> distances;
  for (std::size_t i = 0; i < scans.size(); i += kEveryScan) {
    for (std::size_t j = 0; j < i; j += kEveryScan) {
      if (scans[i].stamp - scans[j].stamp < kRevisitAfter) continue;
      const Se2 apart = scans[i].T_map_vehicle.Inverse() * scans[j].T_map_vehicle;
      if (apart.translation().norm() > kRevisitWithin || std::abs(apart.yaw()) > kRevisitTurned ||
          scans[j].p_map.empty()) {
        continue;
      }
      ++misfit.pairs;
      for (std::size_t k = 0; k < scans[i].p_map.size(); k += kEveryBeam) {
        double nearest = std::numeric_limits<double>::infinity();
        for (const Eigen::Vector2d& other : scans[j].p_map) {
          nearest = std::min(nearest, (other - scans[i].p_map[k]).squaredNorm());
        }
        distances.push_back(std::sqrt(nearest));
      }
    }
  }
  misfit.median_m =
      distances.empty() ? std::numeric_limits<double>::quiet_NaN() : Median(std::move(distances));
  return misfit;
}

Chart DrawLidarMap(const LidarLog& log,
                   const ParkResult& result,
                   const LidarFrontEndOptions& options) {
  Chart chart{.title = log.name + ": " + result.method,
              .x_label = "x [m]",
              .y_label = "y [m]",
              .series = {{"landmarks", {}, false, 1.8},
                         {"path", {}, false, 0.9},
                         {"walls", {}, false, 0.4}},
              .equal_axes = true};
  for (const Eigen::Vector2d& landmark : result.landmarks) {
    chart.series[0].points.push_back(landmark);
  }
  const std::vector<PlacedScan> scans = PlaceScans(log, result.trajectory, options);
  for (std::size_t i = 0; i < scans.size(); i += kEveryScan) {
    chart.series[1].points.push_back(scans[i].T_map_vehicle.translation());
    for (std::size_t k = i % kEveryBeam; k < scans[i].p_map.size(); k += kEveryBeam) {
      chart.series[2].points.push_back(scans[i].p_map[k]);
    }
  }
  return chart;
}

}  // namespace shiftmap

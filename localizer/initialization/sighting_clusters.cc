// SPDX-License-Identifier: Apache-2.0
#include "localizer/initialization/sighting_clusters.h"

#include <algorithm>
#include <cmath>

#include "localizer/models/observation_model.h"

namespace shiftmap {
namespace {

constexpr double kClusterSigmas = 3.0;  // Up to which two sightings are of one place.

Odometer Interpolate(const Odometer& a, const Odometer& b, double share_b) {
  Odometer mean;
  mean.time_s = a.time_s + share_b * (b.time_s - a.time_s);
  mean.distance_m = a.distance_m + share_b * (b.distance_m - a.distance_m);
  mean.turn_rad = a.turn_rad + share_b * (b.turn_rad - a.turn_rad);
  mean.p_odom_vehicle = a.p_odom_vehicle + share_b * (b.p_odom_vehicle - a.p_odom_vehicle);
  return mean;
}

void AddSighting(const SightingCluster& sighting,
                 const OdometryCalibration& calibration,
                 std::vector<SightingCluster>* clusters) {
  for (SightingCluster& cluster : *clusters) {
    if (cluster.group != sighting.group) continue;
    const double variance = cluster.variance + sighting.variance +
                            DriftVariance(cluster, sighting.odometer, calibration);
    const double distance = (cluster.p_odom - sighting.p_odom).norm();
    if (distance > kClusterSigmas * std::sqrt(variance)) continue;
    ++cluster.count;
    const double share = 1.0 / cluster.count;
    cluster.p_odom += share * (sighting.p_odom - cluster.p_odom);
    cluster.variance += share * (sighting.variance - cluster.variance);
    cluster.odometer = Interpolate(cluster.odometer, sighting.odometer, share);
    return;
  }
  clusters->push_back(sighting);
}

}  // namespace

Drift DriftBetween(const Odometer& a, const Odometer& b, const OdometryCalibration& calibration) {
  const double elapsed_s = std::abs(a.time_s - b.time_s);
  const double distance = calibration.sd_log_scale * std::abs(a.distance_m - b.distance_m);
  const double turn = calibration.sd_log_scale * std::abs(a.turn_rad - b.turn_rad);
  return {calibration.noise_v * calibration.noise_v * elapsed_s + distance * distance,
          calibration.noise_omega * calibration.noise_omega * elapsed_s + turn * turn};
}

double DriftVariance(const SightingCluster& cluster,
                     const Odometer& b,
                     const OdometryCalibration& calibration) {
  const Drift drift = DriftBetween(cluster.odometer, b, calibration);
  const double lever = (cluster.p_odom - b.p_odom_vehicle).norm();
  return drift.position + drift.yaw * lever * lever;
}

std::vector<ReckonedScan> DeadReckon(std::span<const WindowScan> window) {
  std::vector<ReckonedScan> path(window.size());
  for (std::size_t i = 1; i < window.size(); ++i) {
    const Se2& step = window[i].motion.increment.T_begin_end;
    path[i].T_odom_vehicle = path[i - 1].T_odom_vehicle * step;
    Odometer& odometer = path[i].odometer;
    odometer.time_s = path[i - 1].odometer.time_s + window[i].motion.elapsed_s;
    odometer.distance_m = path[i - 1].odometer.distance_m + step.translation().norm();
    odometer.turn_rad = path[i - 1].odometer.turn_rad + std::abs(step.yaw());
    odometer.p_odom_vehicle = path[i].T_odom_vehicle.translation();
  }
  return path;
}

std::vector<SightingCluster> ClusterSightings(std::span<const WindowScan> window,
                                              const MapSnapshot& snapshot,
                                              int max_clusters) {
  const Calibration& calibration = snapshot.calibration();
  const std::vector<ReckonedScan> path = DeadReckon(window);
  std::vector<SightingCluster> clusters;
  for (std::size_t i = 0; i < window.size(); ++i) {
    for (const Observation& observation : window[i].scan.observations) {
      SightingCluster sighting;
      sighting.group = snapshot.GroupIndex(observation.signature);
      if (sighting.group < 0) continue;
      const Eigen::Matrix2d cov =
          PositionNoiseInVehicle(observation, ObservationNoise(observation, calibration.sensor));
      sighting.p_odom = LandmarkPosition(observation, path[i].T_odom_vehicle);
      sighting.variance = 0.5 * cov.trace();
      sighting.count = 1;
      sighting.odometer = path[i].odometer;
      AddSighting(sighting, calibration.odometry, &clusters);
    }
  }
  std::stable_sort(
      clusters.begin(), clusters.end(), [](const SightingCluster& a, const SightingCluster& b) {
        return a.count > b.count;
      });
  if (clusters.size() > static_cast<std::size_t>(max_clusters)) {
    clusters.resize(static_cast<std::size_t>(max_clusters));
  }
  return clusters;
}

}  // namespace shiftmap

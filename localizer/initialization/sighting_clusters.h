// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "localizer/filter/odometry_buffer.h"
#include "localizer/models/field_of_view.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// A scan and how the vehicle got there.
struct WindowScan {
  Scan scan;
  OdometryBuffer::Motion motion;  ///< Since the scan before.
  LidarView lidar = {};           ///< At the scan.
};

/// How far dead reckoning had come at a time, for what it may be wrong by then.
struct Odometer {
  double time_s = 0.0;      ///< Since the begin of the window. [s]
  double distance_m = 0.0;  ///< Driven. [m]
  double turn_rad = 0.0;    ///< Turned, without sign. [rad]
  Eigen::Vector2d p_odom_vehicle = Eigen::Vector2d::Zero();
};

/// Where dead reckoning was at a scan of a window.
struct ReckonedScan {
  Se2 T_odom_vehicle;
  Odometer odometer;
};

/// The dead-reckoned path through a window, by scan.
std::vector<ReckonedScan> DeadReckon(std::span<const WindowScan> window);

/// Sightings of one known landmark at one place of the dead-reckoned frame `odom`, the vehicle's
/// frame at the first scan of the window.
struct SightingCluster {
  int group = 0;  ///< Index into MapSnapshot::groups().
  Eigen::Vector2d p_odom = Eigen::Vector2d::Zero();
  double variance = 0.0;  ///< Of each coordinate, sensor noise alone. [m²]
  int count = 0;
  Odometer odometer;  ///< Mean over the sightings.
};

/// Variances by which dead reckoning may have drifted between two times.
struct Drift {
  double position = 0.0;  ///< [m²]
  double yaw = 0.0;       ///< [rad²]
};
Drift DriftBetween(const Odometer& a, const Odometer& b, const OdometryCalibration& calibration);

/// Variance, per coordinate, of where a landmark seen at `a` appears to one who is at `b`. [m²]
double DriftVariance(const SightingCluster& cluster,
                     const Odometer& b,
                     const OdometryCalibration& calibration);

/// Condenses a window into clusters, those with the most sightings first, at most `max_clusters`.
/// A misread signature makes a cluster of its own. Signatures unknown to the map are skipped.
std::vector<SightingCluster> ClusterSightings(std::span<const WindowScan> window,
                                              const MapSnapshot& snapshot,
                                              int max_clusters);

}  // namespace shiftmap

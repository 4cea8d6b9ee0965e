// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "localizer/models/motion_model.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// How hard a simulated visit is.
struct VisitScene {
  double sd_pose_m = 0.1;      ///< Of x and of y at the start. [m]
  double sd_yaw_rad = 0.03;    ///< [rad]
  double sd_mode_m = 0.05;     ///< Of each coordinate of a mode in the map. [m]
  int groups = 3;              ///< In view at the start, >= 1.
  int modes = 2;               ///< Per group, >= 1.
  double spacing_min_m = 0.3;  ///< Between modes of a group, at least. [m]
  double spacing_max_m = 1.0;  ///< From a group's first mode to the others, at most. [m]
  double absent_share = 0.05;  ///< Prior of `absent`.
  double detection_probability = 0.7;
  double clutter_density_per_m2 = 1e-4;  ///< And as much for new landmarks.

  /// Share of detections whose noise has six times the standard deviation.
  double outlier_share = 0.0;
  int scans = 40;

  /// Before the first scan the vehicle drives for as long without a sighting, with the odometry of
  /// a vehicle that has been calibrated. [s]
  double blind_s = 0.0;
  double slip_share = 0.0;  ///< Of blind drives, those in which wheels slip for up to five seconds.
  int alone_scans = 0;      ///< In the first scans the first landmark alone is seen.
};

/// One drive past a few landmarks: what a localizer gets, and the truth.
struct SimulatedVisit {
  MapContent content;
  PoseWithCovariance start;
  std::vector<MotionIncrement> motions;  ///< Before each scan.
  std::vector<double> elapsed_s;         ///< And its duration. [s]
  std::vector<Scan> scans;               ///< Each signature at most once.

  std::vector<int> true_states;              ///< By group.
  std::vector<Eigen::Vector2d> p_landmarks;  ///< By group, where it is not absent. [m]
  std::vector<Se2> T_map_vehicle;            ///< By scan.
};

/// Seconds between the scans of a simulated visit.
inline constexpr double kVisitScanPeriod = 0.3;

/// Stamp of a scan of a simulated visit; -1 for that of the start.
Stamp VisitStamp(int scan);

/// Draws a visit from the model that the localizer assumes: map and priors at random, then states
/// from the priors, modes from the map's covariance, pose from its covariance, the vehicle's scales
/// and slip, the sensor's bias and noise, occlusions, detections within the sector, and false
/// alarms evenly over it.
SimulatedVisit SimulateVisit(const VisitScene& scene, std::uint64_t seed);

}  // namespace shiftmap

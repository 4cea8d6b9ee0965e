// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "mapper/mapper.h"
#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"
#include "tools/convert/victoria_park.h"

namespace shiftmap {

/// A trajectory against GPS fixes, after the rigid alignment that fits best.
struct GpsScore {
  double rmse_m = 0.0;      ///< Of the fixes that count.
  double median_m = 0.0;    ///< Of all fixes.
  double used_share = 0.0;  ///< Of fixes that count: the receiver jumps by metres at times.
  Se2 T_gps_start;          ///< The alignment.
};

/// Fixes beyond four medians do not count; alignment and choice in turn, until they agree.
/// @param p_vehicle_antenna  Where the antenna is on the vehicle. [m]
/// Errors: kInvalidArgument if fewer than two fixes fall within the trajectory.
StatusOr<GpsScore> ScoreAgainstGps(std::span<const StampedPose> trajectory,
                                   std::span<const GpsFix> fixes,
                                   const Eigen::Vector2d& p_vehicle_antenna);

/// The poses at scans that odometry alone gives.
std::vector<StampedPose> DeadReckonScans(const Run& run, const OdometryCalibration& odometry);

/// A run with every n-th of its scans.
Run WithEveryScan(int n, const Run& run);

/// What one method made of the run.
struct ParkResult {
  std::string method;
  std::vector<StampedPose> trajectory = {};
  std::vector<Eigen::Vector2d> landmarks = {};  ///< In the frame of the trajectory.
  int observations = 0;
  int associated = 0;
  double cpu_s = 0.0;
};

ParkResult RunDeadReckoning(const Run& run, const Calibration& calibration);

/// The front end by itself: EKF-SLAM with joint compatibility or with nearest neighbours.
ParkResult RunFilter(const Run& run, const MapperOptions& options, bool joint);

/// BuildMap() with anonymous landmarks associated. Errors: as BuildMap().
StatusOr<ParkResult> RunMapper(const Run& run, const MapperOptions& options);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
//
// What files with 2D lidar scans hold, before anything is made of the scans.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"
#include "tools/lidar/lidar_observations.h"

namespace shiftmap {

struct RangeScan {
  Stamp stamp;
  std::vector<double> ranges_m;  ///< One per beam, counter-clockwise.
};

struct LidarLog {
  std::string name;  ///< Of the file.

  /// Where the log says that the vehicle was, in a frame of its own: raw odometry, unless the log
  /// was corrected. By stamp, one per scan at least.
  std::vector<StampedPose> poses;

  std::vector<RangeScan> scans;  ///< By stamp.

  /// Of the sensor, if the log says.
  std::optional<double> field_of_view_rad;
  std::optional<double> max_range_m;

  std::int64_t skipped_rows = 0;  ///< Of other kinds.
};

/// Velocities that lead from pose to pose (IntegrateOdometry()).
///
/// Between two poses T_a_b = Exp(x, y, ω) in a's frame. What is not along the arc that wheels can
/// drive, α = atan2(y, x), is turned to and turned back from: T_a_b = R(α) Exp(ρ, 0, ω) R(-α). What
/// would take turns of more than 1 rad/s for half of the time, a speed of more than 90 m/s or a yaw
/// rate of more than 45 rad/s is made good on the way to the next poses: a robot that turns on the
/// spot and slides by centimetres, or two stamps that are milliseconds apart and should not be.
///
/// A sample holds for a short time only, so that one is written each second. What the vehicle did
/// in a gap of more than a minute it did within the first.
/// @param poses  By stamp; of equal stamps the last counts.
std::vector<OdometrySample> OdometryFromPoses(std::span<const StampedPose> poses);

/// Odometry and interest points of a log.
/// @param keep_scans  Also the scans themselves; what is no return is 0 in them.
/// Errors: kInvalidArgument if the log has no scan, or
/// something of it is out of range.
StatusOr<Run> MakeLidarRun(const LidarLog& log,
                           const std::string& vehicle,
                           const LidarFrontEndOptions& options,
                           bool keep_scans = false);

}  // namespace shiftmap

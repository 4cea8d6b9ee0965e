// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "proto/core/status.h"
#include "tools/convert/lidar_log.h"

namespace shiftmap {

/// Reads a log of CARMEN, the Carnegie Mellon robot navigation toolkit:
///
///     ODOM x y theta tv rv accel time host logger_time
///     FLASER n range... x y theta odom_x odom_y odom_theta time host logger_time
///     ROBOTLASER1 type start_angle field_of_view angular_resolution max_range accuracy
///                 remission_mode n range... m remission... laser_x laser_y laser_theta
///                 x y theta tv rv forward side turn_axis time host logger_time
///
/// Poses are those of ODOM rows and the robot's (not the laser's) of scans. Scans are the rows of
/// that kind, FLASER or ROBOTLASER1, which the log has first: some logs hold each scan as both.
/// Other rows are skipped and counted. Rows are written in the order in which messages arrived,
/// and are sorted here by the time that they were made at.
///
/// Errors: kNotFound; kUnavailable if the file cannot be read; kInvalidArgument, as
/// `<file>:<line>: ...`, for a row that is malformed, and for a field of view that is not symmetric
/// or changes.
StatusOr<LidarLog> ReadCarmen(const std::string& path);

}  // namespace shiftmap

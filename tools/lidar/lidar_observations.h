// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "mapstore/core/stamp.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"
#include "tools/lidar/interest_points.h"
#include "tools/lidar/scan_points.h"

namespace shiftmap {

/// How lidar scans become observations.
struct LidarFrontEndOptions {
  LidarSensor sensor;
  InterestPointOptions points;

  /// Points further away are left out: there beams lie too far apart to tell where a corner is.
  /// [m]
  double max_point_range_m = 10.0;

  /// Noise that points are logged with, standard deviations: along and across the beam, and, in
  /// every direction, of where on a rounded or ragged thing the point is found. [m], [rad], [m]
  double sd_range_m = 0.03;
  double sd_bearing_rad = 0.01;
  double sd_place_m = 0.05;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// The interest points of a scan as observations without signature: positions in the vehicle frame,
/// T-IV (29), each with its covariance. [m, m²]
/// @param ranges_m  One per beam. [m]
/// Precondition: the options are valid.
Scan ObserveInterestPoints(Stamp stamp,
                           std::span<const double> ranges_m,
                           const LidarFrontEndOptions& options);

}  // namespace shiftmap

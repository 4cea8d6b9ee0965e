// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <numbers>
#include <span>
#include <vector>

#include "mapstore/geometry/se2.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A 2D lidar: n beams at equal steps, counter-clockwise, the first and the last at the ends of the
/// field of view, which is symmetric about the lidar's x axis.
struct LidarSensor {
  double field_of_view_rad = std::numbers::pi;  ///< In (0, 2π). [rad]

  /// A range that is not below this, or not above 0, is no return. [m]
  double max_range_m = 80.0;

  Se2 T_vehicle_lidar = {};  ///< How it is mounted.

  /// Direction of a beam in the lidar frame. Precondition: beams >= 2. [rad]
  double Bearing(std::size_t beam, std::size_t beams) const {
    return field_of_view_rad * (static_cast<double>(beam) / static_cast<double>(beams - 1) - 0.5);
  }

  bool Returned(double range_m) const { return range_m > 0.0 && range_m < max_range_m; }

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// What a beam hit.
struct ScanPoint {
  int beam = 0;
  double range_m = 0.0;
  Eigen::Vector2d p_lidar = Eigen::Vector2d::Zero();  ///< Lidar frame. [m]
};

/// The returns of a scan, by beam. @param ranges_m  One per beam.
std::vector<ScanPoint> ScanPoints(std::span<const double> ranges_m, const LidarSensor& sensor);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "mapstore/run/lidar_scan.h"

namespace shiftmap {

/// What a beam hit.
struct ScanPoint {
  int beam = 0;
  double range_m = 0.0;
  Eigen::Vector2d p_lidar = Eigen::Vector2d::Zero();  ///< Lidar frame. [m]
};

/// The returns of a scan, by beam. @param ranges_m  One per beam.
std::vector<ScanPoint> ScanPoints(std::span<const double> ranges_m, const LidarSensor& sensor);

}  // namespace shiftmap

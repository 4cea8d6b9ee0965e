// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapstore/run/lidar_scan.h"

namespace shiftmap {

struct Wall {
  Eigen::Vector2d a;
  Eigen::Vector2d b;
};

/// The walls along a line from corner to corner.
std::vector<Wall> WallsAlong(const std::vector<Eigen::Vector2d>& corners, bool closed);

/// What a lidar at that pose measures; 100 m, no return, where no wall is.
std::vector<double> CastScan(const std::vector<Wall>& walls,
                             const Se2& T_map_lidar,
                             std::size_t beams,
                             const LidarSensor& sensor);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapstore/run/lidar_scan.h"
#include "tools/sim/wall.h"

namespace shiftmap {

/// What a lidar at that pose measures, every beam against every wall; 100 m, no return, where no
/// wall is.
std::vector<double> CastScan(const std::vector<Wall>& walls,
                             const Se2& T_map_lidar,
                             std::size_t beams,
                             const LidarSensor& sensor);

}  // namespace shiftmap

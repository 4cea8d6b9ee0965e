// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <random>

#include "mapstore/geometry/se2.h"
#include "tools/sim/odometry_motion.h"

namespace shiftmap {

struct WaypointDriverOptions {
  double size_m = 40.0;    ///< Waypoints lie in [0, size]². [m]
  double speed_mps = 1.5;  ///< Top speed. [m/s]
};

/// Drives smoothly from one random waypoint to the next.
class WaypointDriver {
 public:
  /// @param random  Source of the waypoints; must outlive this.
  WaypointDriver(const WaypointDriverOptions& options, std::mt19937_64* random);

  /// A pose to start from: at rest, towards the first waypoint.
  Se2 Start();

  /// The velocity for the next `seconds`, for a vehicle at T_map_vehicle.
  Velocity Drive(const Se2& T_map_vehicle, double seconds);

 private:
  Eigen::Vector2d NextWaypoint(const Eigen::Vector2d& p_map_vehicle);

  WaypointDriverOptions options_;
  std::mt19937_64* random_;
  Eigen::Vector2d waypoint_ = Eigen::Vector2d::Zero();
  Velocity velocity_;
};

}  // namespace shiftmap

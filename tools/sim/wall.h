// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

namespace shiftmap {

/// A straight piece of what a lidar does not see through. [m], in the map frame.
struct Wall {
  Eigen::Vector2d a;
  Eigen::Vector2d b;
};

/// The walls along a line from corner to corner. Precondition: there is a corner.
std::vector<Wall> WallsAlong(const std::vector<Eigen::Vector2d>& corners, bool closed);

/// Cross product of two vectors of the plane.
inline double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace shiftmap

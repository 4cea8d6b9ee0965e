// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/wall.h"

namespace shiftmap {

std::vector<Wall> WallsAlong(const std::vector<Eigen::Vector2d>& corners, bool closed) {
  std::vector<Wall> walls;
  for (std::size_t i = 0; i + 1 < corners.size(); ++i) {
    walls.push_back({corners[i], corners[i + 1]});
  }
  if (closed) walls.push_back({corners.back(), corners.front()});
  return walls;
}

}  // namespace shiftmap

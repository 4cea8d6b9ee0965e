// SPDX-License-Identifier: Apache-2.0
#include "mapper/problem/mode_grid.h"

#include <cmath>

#include "proto/core/check.h"

namespace shiftmap {

ModeGrid::ModeGrid(const MapProblem& problem, double radius_m) : cell_m_(radius_m) {
  SHIFTMAP_CHECK(radius_m > 0.0, "radius {}", radius_m);
  for (std::size_t group = 0; group < problem.modes.size(); ++group) {
    for (std::size_t k = 0; k < problem.modes[group].size(); ++k) {
      const Eigen::Vector2d& position = problem.modes[group][k].p_map_landmark;
      const Cell cell = CellOf(position);
      cells_[Key(cell.x, cell.y)].push_back(
          {static_cast<int>(group), static_cast<int>(k), position});
    }
  }
}

ModeGrid::Cell ModeGrid::CellOf(const Eigen::Vector2d& point) const {
  return {static_cast<std::int64_t>(std::floor(point.x() / cell_m_)),
          static_cast<std::int64_t>(std::floor(point.y() / cell_m_))};
}

}  // namespace shiftmap

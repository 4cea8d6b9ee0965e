// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/mode_grid.h"

#include <algorithm>
#include <cmath>

#include "proto/core/check.h"

namespace shiftmap {

ModeGrid::ModeGrid(const MapSnapshot& snapshot, double cell_m) : cell_m_(cell_m) {
  SHIFTMAP_CHECK(cell_m > 0.0, "cell {} m", cell_m);
  for (std::size_t i = 0; i < snapshot.groups().size(); ++i) {
    for (const Mode& mode : snapshot.groups()[i].modes) {
      const Eigen::Vector2d& p = mode.p_map_landmark;
      cells_[Key(CellOf(p.x()), CellOf(p.y()))].push_back({static_cast<int>(i), p});
    }
  }
}

void ModeGrid::GroupsNear(const Eigen::Vector2d& p_map,
                          double radius_m,
                          std::vector<int>* groups) const {
  groups->clear();
  for (std::int64_t column = CellOf(p_map.x() - radius_m); column <= CellOf(p_map.x() + radius_m);
       ++column) {
    for (std::int64_t row = CellOf(p_map.y() - radius_m); row <= CellOf(p_map.y() + radius_m);
         ++row) {
      const auto found = cells_.find(Key(column, row));
      if (found == cells_.end()) continue;
      for (const Entry& entry : found->second) {
        if ((entry.p_map_landmark - p_map).norm() <= radius_m) groups->push_back(entry.group);
      }
    }
  }
  std::sort(groups->begin(), groups->end());
  groups->erase(std::unique(groups->begin(), groups->end()), groups->end());
}

std::int64_t ModeGrid::CellOf(double coordinate) const {
  // Far beyond any map, so that a cell always fits half a key.
  constexpr double kMaxCell = 1e9;
  return std::llround(std::clamp(std::floor(coordinate / cell_m_), -kMaxCell, kMaxCell));
}

std::int64_t ModeGrid::Key(std::int64_t column, std::int64_t row) {
  return column * (std::int64_t{1} << 32) + row;
}

}  // namespace shiftmap

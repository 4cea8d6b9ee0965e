// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/mode_grid.h"

#include <algorithm>
#include <cmath>

#include "proto/core/check.h"

namespace shiftmap {

ModeGrid::ModeGrid(double cell_m) : cell_m_(cell_m) {
  SHIFTMAP_CHECK(cell_m > 0.0, "cell {} m", cell_m);
}

ModeGrid::ModeGrid(const MapSnapshot& snapshot, double cell_m) : ModeGrid(cell_m) {
  for (std::size_t i = 0; i < snapshot.groups().size(); ++i) {
    const std::vector<Mode>& modes = snapshot.groups()[i].modes;
    for (std::size_t k = 0; k < modes.size(); ++k) {
      Add({static_cast<int>(i), static_cast<int>(k), modes[k].p_map_landmark});
    }
  }
}

void ModeGrid::Add(const Entry& entry) {
  const Eigen::Vector2d& p = entry.p_map_landmark;
  cells_[Key(CellOf(p.x()), CellOf(p.y()))].push_back(entry);
}

void ModeGrid::GroupsNear(const Eigen::Vector2d& p_map,
                          double radius_m,
                          std::vector<int>* groups) const {
  groups->clear();
  VisitNear(p_map, radius_m, [&](const Entry& entry) {
    if ((entry.p_map_landmark - p_map).norm() <= radius_m) groups->push_back(entry.group);
  });
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

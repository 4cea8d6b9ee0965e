// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// Finds the groups that have a mode near a place in time independent of the size of the map.
///
/// Threads: const-safe. Ownership: holds no reference to the snapshot.
class ModeGrid {
 public:
  /// @param cell_m  Edge of a cell; best about the radius of the queries. > 0. [m]
  ModeGrid(const MapSnapshot& snapshot, double cell_m);

  /// The groups with a mode within `radius_m` of a point, ascending, each once.
  void GroupsNear(const Eigen::Vector2d& p_map, double radius_m, std::vector<int>* groups) const;

 private:
  struct Entry {
    int group = 0;
    Eigen::Vector2d p_map_landmark;
  };

  static std::int64_t Key(std::int64_t column, std::int64_t row);
  std::int64_t CellOf(double coordinate) const;

  double cell_m_;
  std::unordered_map<std::int64_t, std::vector<Entry>> cells_;
};

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// Finds the modes near a place in time independent of the size of the map.
///
/// Threads: const-safe. Ownership: holds no reference to the snapshot.
class ModeGrid {
 public:
  struct Entry {
    int group = 0;
    int mode = 0;                                              ///< In the group.
    Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();  ///< [m]
  };

  /// @param cell_m  Edge of a cell; best about the radius of the queries. > 0. [m]
  explicit ModeGrid(double cell_m);

  /// The modes of a map.
  ModeGrid(const MapSnapshot& snapshot, double cell_m);

  void Add(const Entry& entry);

  /// Calls `visit(entry)` once for every mode within `radius_m` of a point, and for some beyond.
  template <typename Visitor>
  void VisitNear(const Eigen::Vector2d& p_map, double radius_m, const Visitor& visit) const {
    const std::int64_t last_column = CellOf(p_map.x() + radius_m);
    const std::int64_t last_row = CellOf(p_map.y() + radius_m);
    for (std::int64_t column = CellOf(p_map.x() - radius_m); column <= last_column; ++column) {
      for (std::int64_t row = CellOf(p_map.y() - radius_m); row <= last_row; ++row) {
        const auto found = cells_.find(Key(column, row));
        if (found == cells_.end()) continue;
        for (const Entry& entry : found->second) visit(entry);
      }
    }
  }

  /// The groups with a mode within `radius_m` of a point, ascending, each once.
  void GroupsNear(const Eigen::Vector2d& p_map, double radius_m, std::vector<int>* groups) const;

 private:
  static std::int64_t Key(std::int64_t column, std::int64_t row);
  std::int64_t CellOf(double coordinate) const;

  double cell_m_;
  std::unordered_map<std::int64_t, std::vector<Entry>> cells_;
};

}  // namespace shiftmap

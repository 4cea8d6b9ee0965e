// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "mapper/problem/map_problem.h"

namespace shiftmap {

/// The modes of a problem by where they are, for questions about what is around a vehicle.
class ModeGrid {
 public:
  struct Entry {
    int group = 0;
    int mode = 0;                                              ///< In the group.
    Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();  ///< [m]
  };

  /// @param radius_m  Of the largest circle that is asked for; > 0.
  ModeGrid(const MapProblem& problem, double radius_m);

  /// Calls `visit(entry)` for every mode within `radius_m` of a point, and for some beyond.
  template <typename Visitor>
  void VisitNear(const Eigen::Vector2d& point, const Visitor& visit) const {
    const auto [x, y] = CellOf(point);
    for (std::int64_t dx = -1; dx <= 1; ++dx) {
      for (std::int64_t dy = -1; dy <= 1; ++dy) {
        const auto found = cells_.find(Key(x + dx, y + dy));
        if (found == cells_.end()) continue;
        for (const Entry& entry : found->second) visit(entry);
      }
    }
  }

 private:
  struct Cell {
    std::int64_t x = 0;
    std::int64_t y = 0;
  };

  Cell CellOf(const Eigen::Vector2d& point) const;
  // Cells far apart may share a key, whose modes are then more than were asked for.
  static std::uint64_t Key(std::int64_t x, std::int64_t y) {
    return (static_cast<std::uint64_t>(x) << 32U) ^ (static_cast<std::uint64_t>(y) & 0xffffffffU);
  }

  double cell_m_;
  std::unordered_map<std::uint64_t, std::vector<Entry>> cells_;
};

}  // namespace shiftmap

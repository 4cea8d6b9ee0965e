// SPDX-License-Identifier: Apache-2.0
//
// What a ray hits first among many walls.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "tools/sim/wall.h"

namespace shiftmap {

struct RayHit {
  double range_m = std::numeric_limits<double>::infinity();  ///< Infinite: nothing was hit. [m]
  double cos_incidence = 1.0;  ///< Of the angle between ray and the wall's normal, in [0, 1].

  bool hit() const { return range_m < std::numeric_limits<double>::infinity(); }
};

/// A uniform grid over walls. A ray walks it from cell to cell (Amanatides and Woo, A fast voxel
/// traversal algorithm for ray tracing, Eurographics 1987) and ends in the first cell in which it
/// hits. Hits differ from those of brute force by rounding, about 1e-9 m.
///
/// Threads: const-safe. No call allocates.
class RayCaster {
 public:
  /// @param walls   Finite. A wall without length is never hit.
  /// @param cell_m  Edge of a cell, > 0; larger where walls would need more than 4 million. [m]
  explicit RayCaster(std::span<const Wall> walls, double cell_m = 2.0);

  /// The nearest wall from `p_map` on. @param direction  Of unit length. @param max_range_m  Walls
  /// further away are not looked at; may be infinite.
  RayHit Cast(const Eigen::Vector2d& p_map,
              const Eigen::Vector2d& direction,
              double max_range_m) const;

  /// Whether no wall stands between two points; one within 1 mm of the second does not.
  bool InSight(const Eigen::Vector2d& p_map, const Eigen::Vector2d& q_map) const;

 private:
  // A wall as the intersection needs it.
  struct Segment {
    Eigen::Vector2d a;
    Eigen::Vector2d along;
  };

  void PlaceGrid(std::span<const Wall> walls, double cell_m);
  std::size_t CellOf(int column, int row) const;
  template <typename Visit>
  void ForEachCellOf(const Wall& wall, const Visit& visit) const;

  Eigen::Vector2d origin_ = Eigen::Vector2d::Zero();  // Corner of the grid. [m]
  double cell_m_ = 2.0;
  int columns_ = 1;
  int rows_ = 1;
  std::vector<std::uint32_t> begin_;  // Of each cell's segments, then their number.
  std::vector<Segment> segments_;     // By cell: each wall in every cell that it may touch.
};

}  // namespace shiftmap

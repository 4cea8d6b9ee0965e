// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

namespace shiftmap {

/// Finds places for labels near their points where they cover nothing that is there already.
/// Coordinates in pixels, y down. The time of a label goes with what is near it.
class LabelPlacer {
 public:
  /// @param min, max  Corners of the area that no label leaves.
  LabelPlacer(const Eigen::Vector2d& min, const Eigen::Vector2d& max) : area_{min, max} {}

  /// Marks a circle as taken, by its bounding box.
  void Occupy(const Eigen::Vector2d& centre, double radius);

  /// Marks the boxes along a line as taken, `width` wide.
  void OccupyLine(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double width);

  /// The lower left corner for a label of `size` near a point, which is then taken; nothing if
  /// every place is.
  /// @param distance  Between the point and the label.
  /// @param rings     How many distances are tried: the first, and others ever farther out.
  std::optional<Eigen::Vector2d> Place(const Eigen::Vector2d& point,
                                       double distance,
                                       const Eigen::Vector2d& size,
                                       int rings = 1);

 private:
  struct Box {
    Eigen::Vector2d min;
    Eigen::Vector2d max;

    bool Overlaps(const Box& other) const {
      return (min.array() < other.max.array()).all() && (other.min.array() < max.array()).all();
    }
  };

  bool IsFree(const Box& box) const;
  void Take(const Box& box);

  Box area_;
  std::unordered_map<std::int64_t, std::vector<Box>> taken_;  // By cell.
};

}  // namespace shiftmap

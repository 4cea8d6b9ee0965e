// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace shiftmap {

/// Finds places for labels beside their points where they cover nothing that is there already.
/// Coordinates in pixels, y down. Quadratic in the number of labels.
class LabelPlacer {
 public:
  /// Marks a circle as taken, by its bounding box.
  void Occupy(const Eigen::Vector2d& centre, double radius);

  /// The lower left corner for a label of `size` beside a point, which is then taken.
  /// @param distance  Between the point and the label.
  /// @param force     Take the place that covers least if all cover something; otherwise nothing
  ///                  is returned then.
  std::optional<Eigen::Vector2d> Place(const Eigen::Vector2d& point,
                                       double distance,
                                       const Eigen::Vector2d& size,
                                       bool force);

 private:
  struct Box {
    Eigen::Vector2d min;
    Eigen::Vector2d max;
  };

  double Covered(const Box& box) const;

  std::vector<Box> taken_;
};

}  // namespace shiftmap

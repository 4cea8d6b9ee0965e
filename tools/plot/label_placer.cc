// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/label_placer.h"

#include <algorithm>
#include <limits>

namespace shiftmap {

void LabelPlacer::Occupy(const Eigen::Vector2d& centre, double radius) {
  const Eigen::Vector2d half = Eigen::Vector2d::Constant(radius);
  taken_.push_back({centre - half, centre + half});
}

double LabelPlacer::Covered(const Box& box) const {
  double area = 0.0;
  for (const Box& other : taken_) {
    const Eigen::Vector2d overlap =
        (box.max.cwiseMin(other.max) - box.min.cwiseMax(other.min)).cwiseMax(0.0);
    area += overlap.prod();
  }
  return area;
}

std::optional<Eigen::Vector2d> LabelPlacer::Place(const Eigen::Vector2d& point,
                                                  double distance,
                                                  const Eigen::Vector2d& size,
                                                  bool force) {
  // Upper corner of the label relative to the point; the best liked first.
  const double w = size.x();
  const double h = size.y();
  const double d = distance;
  const Eigen::Vector2d offsets[] = {{d, -0.5 * h - 0.5 * d},
                                     {-d - w, -0.5 * h - 0.5 * d},
                                     {-0.5 * w, -d - h},
                                     {-0.5 * w, d},
                                     {d, 0.5 * d},
                                     {-d - w, 0.5 * d},
                                     {d, -d - h},
                                     {-d - w, -d - h}};
  double least = std::numeric_limits<double>::infinity();
  Box best{point, point};
  for (const Eigen::Vector2d& offset : offsets) {
    const Box box{point + offset, point + offset + size};
    const double covered = Covered(box);
    if (covered < least) {
      least = covered;
      best = box;
    }
  }
  if (least > 0.0 && !force) return std::nullopt;
  taken_.push_back(best);
  return Eigen::Vector2d(best.min.x(), best.max.y());
}

}  // namespace shiftmap

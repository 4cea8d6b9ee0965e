// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/label_placer.h"

#include <algorithm>
#include <cmath>

namespace shiftmap {
namespace {

constexpr double kCell = 40.0;

// Calls `visit` with the key of each cell that a box touches, until it returns false.
template <typename Visit>
bool ForEachCell(const Eigen::Vector2d& min, const Eigen::Vector2d& max, const Visit& visit) {
  const auto cell = [](double pixel) {
    return static_cast<std::int64_t>(std::floor(pixel / kCell));
  };
  for (std::int64_t row = cell(min.y()); row <= cell(max.y()); ++row) {
    for (std::int64_t column = cell(min.x()); column <= cell(max.x()); ++column) {
      constexpr std::int64_t kRows = std::int64_t{1} << 32;
      if (!visit(row * kRows + column)) return false;
    }
  }
  return true;
}

// Directions from a point to its label, y down; the best liked first.
constexpr double kDirections[][2] = {{1.0, -0.4},
                                     {-1.0, -0.4},
                                     {0.0, -1.0},
                                     {0.0, 1.0},
                                     {1.0, 0.6},
                                     {-1.0, 0.6},
                                     {0.9, -1.0},
                                     {-0.9, -1.0},
                                     {0.9, 1.0},
                                     {-0.9, 1.0}};

}  // namespace

bool LabelPlacer::IsFree(const Box& box) const {
  if ((box.min.array() < area_.min.array()).any() || (box.max.array() > area_.max.array()).any()) {
    return false;
  }
  return ForEachCell(box.min, box.max, [&](std::int64_t cell) {
    const auto boxes = taken_.find(cell);
    return boxes == taken_.end() ||
           std::none_of(boxes->second.begin(), boxes->second.end(), [&](const Box& other) {
             return box.Overlaps(other);
           });
  });
}

void LabelPlacer::Take(const Box& box) {
  // Nothing outside of the area keeps a label from its place.
  const Box inside{box.min.cwiseMax(area_.min), box.max.cwiseMin(area_.max)};
  ForEachCell(inside.min, inside.max, [&](std::int64_t cell) {
    taken_[cell].push_back(inside);
    return true;
  });
}

void LabelPlacer::Occupy(const Eigen::Vector2d& centre, double radius) {
  const Eigen::Vector2d half = Eigen::Vector2d::Constant(radius);
  Take({centre - half, centre + half});
}

void LabelPlacer::OccupyLine(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double width) {
  const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / width)));
  for (int i = 0; i <= steps; ++i) Occupy(from + (to - from) * i / steps, 0.5 * width);
}

std::optional<Eigen::Vector2d> LabelPlacer::Place(const Eigen::Vector2d& point,
                                                  double distance,
                                                  const Eigen::Vector2d& size,
                                                  int rings) {
  constexpr double kRing = 13.0;
  for (int ring = 0; ring < rings; ++ring) {
    const Eigen::Vector2d reach = 0.5 * size.array() + distance + ring * kRing;
    for (const auto& direction : kDirections) {
      const Eigen::Vector2d centre =
          point + reach.cwiseProduct(Eigen::Vector2d(direction[0], direction[1]));
      const Box box{centre - 0.5 * size, centre + 0.5 * size};
      if (!IsFree(box)) continue;
      Take(box);
      return Eigen::Vector2d(box.min.x(), box.max.y());
    }
  }
  return std::nullopt;
}

}  // namespace shiftmap

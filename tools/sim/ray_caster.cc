// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/ray_caster.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace shiftmap {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kMaxCells = 4e6;

// Around the walls and around each wall, so that rounding takes no wall out of its cells. [m]
constexpr double kMargin = 1e-6;

// The ray's way through a rectangle: entry and exit, as distances. [m]
struct Stretch {
  double enter = 0.0;
  double leave = kInfinity;
};

std::optional<Stretch> Clip(const Eigen::Vector2d& p,
                            const Eigen::Vector2d& direction,
                            const Eigen::Vector2d& low,
                            const Eigen::Vector2d& high) {
  Stretch stretch;
  for (int axis = 0; axis < 2; ++axis) {
    if (direction[axis] == 0.0) {
      if (p[axis] < low[axis] || p[axis] > high[axis]) return std::nullopt;
      continue;
    }
    const double to_low = (low[axis] - p[axis]) / direction[axis];
    const double to_high = (high[axis] - p[axis]) / direction[axis];
    stretch.enter = std::max(stretch.enter, std::min(to_low, to_high));
    stretch.leave = std::min(stretch.leave, std::max(to_low, to_high));
  }
  if (stretch.enter > stretch.leave) return std::nullopt;
  return stretch;
}

// The cells of one axis that a ray comes through.
struct Walk {
  int cell = 0;
  int step = 0;
  double next = kInfinity;   // Where it leaves the cell. [m]
  double width = kInfinity;  // From there to where it leaves the next. [m]
};

Walk StartWalk(double p, double direction, double origin, double cell_m, int cells, double enter) {
  Walk walk;
  const double at = (p + enter * direction - origin) / cell_m;
  walk.cell = std::clamp(static_cast<int>(std::floor(at)), 0, cells - 1);
  if (direction == 0.0) return walk;
  walk.step = direction > 0.0 ? 1 : -1;
  const double border = origin + cell_m * (walk.cell + (direction > 0.0 ? 1 : 0));
  walk.next = (border - p) / direction;
  walk.width = cell_m / std::abs(direction);
  return walk;
}

double CosIncidence(const Eigen::Vector2d& direction, const Eigen::Vector2d& along) {
  return std::min(1.0, std::abs(Cross(direction, along)) / along.norm());
}

}  // namespace

RayCaster::RayCaster(std::span<const Wall> walls, double cell_m) {
  PlaceGrid(walls, cell_m);
  begin_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0);
  for (const Wall& wall : walls) {
    ForEachCellOf(wall, [&](std::size_t cell) { ++begin_[cell + 1]; });
  }
  for (std::size_t i = 1; i < begin_.size(); ++i) begin_[i] += begin_[i - 1];
  segments_.resize(begin_.back());
  std::vector<std::uint32_t> next(begin_.begin(), begin_.end() - 1);
  for (const Wall& wall : walls) {
    ForEachCellOf(wall, [&](std::size_t cell) {
      segments_[next[cell]++] = {wall.a, wall.b - wall.a};
    });
  }
}

void RayCaster::PlaceGrid(std::span<const Wall> walls, double cell_m) {
  if (walls.empty()) return;
  Eigen::Array2d low = walls.front().a;
  Eigen::Array2d high = low;
  for (const Wall& wall : walls) {
    low = low.min(wall.a.array()).min(wall.b.array());
    high = high.max(wall.a.array()).max(wall.b.array());
  }
  origin_ = low - kMargin;
  const Eigen::Array2d size = high - low + 2.0 * kMargin;
  cell_m_ = std::max({cell_m, std::sqrt(size.prod() / kMaxCells), size.maxCoeff() / kMaxCells});
  columns_ = static_cast<int>(size.x() / cell_m_) + 1;
  rows_ = static_cast<int>(size.y() / cell_m_) + 1;
}

std::size_t RayCaster::CellOf(int column, int row) const {
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
         static_cast<std::size_t>(column);
}

// The cells of each column that the wall crosses, between the heights at which it does.
template <typename Visit>
void RayCaster::ForEachCellOf(const Wall& wall, const Visit& visit) const {
  const auto index = [&](double x, double origin, int count) {
    return std::clamp(static_cast<int>(std::floor((x - origin) / cell_m_)), 0, count - 1);
  };
  const bool ordered = wall.a.x() <= wall.b.x();
  const Eigen::Vector2d& left = ordered ? wall.a : wall.b;
  const Eigen::Vector2d& right = ordered ? wall.b : wall.a;
  const double width = right.x() - left.x();
  const int last = index(right.x() + kMargin, origin_.x(), columns_);
  for (int column = index(left.x() - kMargin, origin_.x(), columns_); column <= last; ++column) {
    double y0 = left.y();
    double y1 = right.y();
    if (width > kMargin) {
      const double slope = (right.y() - left.y()) / width;
      const double from = std::max(left.x(), origin_.x() + cell_m_ * column - kMargin);
      const double to = std::min(right.x(), origin_.x() + cell_m_ * (column + 1) + kMargin);
      y0 = left.y() + slope * (from - left.x());
      y1 = left.y() + slope * (to - left.x());
    }
    const int bottom = index(std::min(y0, y1) - kMargin, origin_.y(), rows_);
    const int top = index(std::max(y0, y1) + kMargin, origin_.y(), rows_);
    for (int row = bottom; row <= top; ++row) visit(CellOf(column, row));
  }
}

RayHit RayCaster::Cast(const Eigen::Vector2d& p_map,
                       const Eigen::Vector2d& direction,
                       double max_range_m) const {
  RayHit nearest;
  const Eigen::Vector2d size(columns_ * cell_m_, rows_ * cell_m_);
  const std::optional<Stretch> stretch = Clip(p_map, direction, origin_, origin_ + size);
  if (!stretch || stretch->enter > max_range_m) return nearest;
  Walk x = StartWalk(p_map.x(), direction.x(), origin_.x(), cell_m_, columns_, stretch->enter);
  Walk y = StartWalk(p_map.y(), direction.y(), origin_.y(), cell_m_, rows_, stretch->enter);
  const Segment* wall = nullptr;
  double range = max_range_m;
  while (true) {
    const std::size_t cell = CellOf(x.cell, y.cell);
    for (std::uint32_t i = begin_[cell]; i < begin_[cell + 1]; ++i) {
      // p + at · direction = a + share · along.
      const Segment& segment = segments_[i];
      const double determinant = Cross(direction, segment.along);
      if (determinant == 0.0) continue;
      const Eigen::Vector2d to_a = segment.a - p_map;
      const double share = Cross(to_a, direction) / determinant;
      const double at = Cross(to_a, segment.along) / determinant;
      if (!(at > 0.0 && at < range && share >= 0.0 && share <= 1.0)) continue;
      range = at;
      wall = &segment;
    }
    const bool along_x = x.next < y.next;
    Walk& walk = along_x ? x : y;
    // A hit may lie in a later cell, of a wall that this cell shares: then a nearer one may follow.
    if (range <= walk.next || walk.step == 0) break;
    walk.cell += walk.step;
    if (walk.cell < 0 || walk.cell >= (along_x ? columns_ : rows_)) break;
    walk.next += walk.width;
  }
  if (wall == nullptr) return nearest;
  nearest.range_m = range;
  nearest.cos_incidence = CosIncidence(direction, wall->along);
  return nearest;
}

bool RayCaster::InSight(const Eigen::Vector2d& p_map, const Eigen::Vector2d& q_map) const {
  constexpr double kTouching = 1e-3;
  const double distance = (q_map - p_map).norm();
  if (distance <= kTouching) return true;
  return !Cast(p_map, (q_map - p_map) / distance, distance - kTouching).hit();
}

}  // namespace shiftmap

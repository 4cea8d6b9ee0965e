// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/tunnels.h"

#include <algorithm>
#include <cmath>

namespace shiftmap {
namespace {

// Where a wall is cut by the edges of a polygon, as shares of its length.
void AddCuts(const Wall& wall, const Outline& outline, std::vector<double>* cuts) {
  const Eigen::Vector2d along = wall.b - wall.a;
  for (const Wall& edge : WallsAlong(outline, true)) {
    const Eigen::Vector2d other = edge.b - edge.a;
    const double determinant = Cross(along, other);
    if (determinant == 0.0) continue;
    const double share = Cross(edge.a - wall.a, other) / determinant;
    const double other_share = Cross(edge.a - wall.a, along) / determinant;
    if (share > 0.0 && share < 1.0 && other_share >= 0.0 && other_share <= 1.0) {
      cuts->push_back(share);
    }
  }
}

bool IsOpenSpace(std::span<const Outline> outlines, std::size_t except, const Eigen::Vector2d& p) {
  for (std::size_t i = 0; i < outlines.size(); ++i) {
    if (i != except && IsInside(outlines[i], p)) return true;
  }
  return false;
}

}  // namespace

Outline TunnelSides::ToOutline() const {
  Outline outline = left;
  outline.insert(outline.end(), right.rbegin(), right.rend());
  return outline;
}

Eigen::Vector2d PointAlong(std::span<const Eigen::Vector2d> line, double distance_m) {
  double left = std::max(0.0, distance_m);
  for (std::size_t i = 0; i + 1 < line.size(); ++i) {
    const Eigen::Vector2d along = line[i + 1] - line[i];
    const double length = along.norm();
    if (left <= length) return line[i] + left / length * along;
    left -= length;
  }
  return line.back();
}

double LengthOf(std::span<const Eigen::Vector2d> line) {
  double length = 0.0;
  for (std::size_t i = 0; i + 1 < line.size(); ++i) length += (line[i + 1] - line[i]).norm();
  return length;
}

TunnelSides DigTunnel(std::span<const Eigen::Vector2d> centre,
                      double width_m,
                      const RoughRock& rock,
                      Random* random) {
  const double length = LengthOf(centre);
  const int steps = std::max(1, static_cast<int>(std::lround(length / rock.step_m)));
  const double step = length / steps;
  TunnelSides sides;
  for (int i = 0; i <= steps; ++i) {
    const Eigen::Vector2d p = PointAlong(centre, i * step);
    const Eigen::Vector2d ahead =
        (PointAlong(centre, (i + 1) * step) - PointAlong(centre, (i - 1) * step)).normalized();
    const Eigen::Vector2d across(-ahead.y(), ahead.x());
    const double sd = i == 0 || i == steps ? 0.0 : rock.sd_m;
    // A bend beyond two standard deviations would close narrow tunnels.
    const auto bend = [&] { return std::clamp(Gaussian(sd, random), -2.0 * sd, 2.0 * sd); };
    sides.left.push_back(p + (0.5 * width_m + bend()) * across);
    sides.right.push_back(p - (0.5 * width_m + bend()) * across);
  }
  return sides;
}

bool IsInside(const Outline& outline, const Eigen::Vector2d& p) {
  bool inside = false;
  for (std::size_t i = 0, j = outline.size() - 1; i < outline.size(); j = i++) {
    const Eigen::Vector2d& a = outline[i];
    const Eigen::Vector2d& b = outline[j];
    if ((a.y() > p.y()) == (b.y() > p.y())) continue;
    if (p.x() < a.x() + (b.x() - a.x()) * (p.y() - a.y()) / (b.y() - a.y())) inside = !inside;
  }
  return inside;
}

std::vector<Wall> WallsOfUnion(std::span<const Outline> outlines) {
  std::vector<Wall> walls;
  for (std::size_t i = 0; i < outlines.size(); ++i) {
    for (const Wall& edge : WallsAlong(outlines[i], true)) {
      std::vector<double> cuts = {0.0, 1.0};
      for (std::size_t j = 0; j < outlines.size(); ++j) {
        if (j != i) AddCuts(edge, outlines[j], &cuts);
      }
      std::sort(cuts.begin(), cuts.end());
      const auto at = [&](double share) -> Eigen::Vector2d {
        return edge.a + share * (edge.b - edge.a);
      };
      for (std::size_t k = 0; k + 1 < cuts.size(); ++k) {
        if (cuts[k] == cuts[k + 1]) continue;
        if (IsOpenSpace(outlines, i, at(0.5 * (cuts[k] + cuts[k + 1])))) continue;
        walls.push_back({at(cuts[k]), at(cuts[k + 1])});
      }
    }
  }
  return walls;
}

}  // namespace shiftmap

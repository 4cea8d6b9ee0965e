// SPDX-License-Identifier: Apache-2.0
#include "tools/lidar/interest_points.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

namespace shiftmap {
namespace {

// The Gaussian is cut off at so many standard deviations.
constexpr double kReach = 3.0;

// Arc length is measured between hits as far apart, some times the noise of ranges. Smaller, and
// noise makes dense scans longer and their corners flatter. [m]
constexpr double kMinStepM = 0.05;

// Behind an edge the farther surface begins so many times further away than the last two hits lie
// apart. [-]
constexpr double kMinEdgeJump = 2.0;

// Hits of neighbouring beams on one surface, points[begin, end).
struct Surface {
  std::size_t begin = 0;
  std::size_t end = 0;
};

bool SameSurface(const ScanPoint& a, const ScanPoint& b, double max_gap_m) {
  return b.beam == a.beam + 1 && (b.p_lidar - a.p_lidar).norm() <= max_gap_m;
}

// Whether a surface ends at `end`, with something farther behind it. On a wall seen at a grazing
// angle hits lie ever further apart; it does not end where they lie too far apart. A beam without
// return says nothing of what is beside: glass and dark surfaces give none.
bool IsEdge(const ScanPoint& inside, const ScanPoint& end, const ScanPoint& beyond) {
  return std::abs(beyond.beam - end.beam) == 1 && beyond.range_m > end.range_m &&
         (beyond.p_lidar - end.p_lidar).norm() >
             kMinEdgeJump * (inside.p_lidar - end.p_lidar).norm();
}

std::vector<Surface> FindSurfaces(const std::vector<ScanPoint>& points, double max_gap_m) {
  std::vector<Surface> surfaces;
  for (std::size_t begin = 0; begin < points.size();) {
    std::size_t end = begin + 1;
    while (end < points.size() && SameSurface(points[end - 1], points[end], max_gap_m)) ++end;
    surfaces.push_back({begin, end});
    begin = end;
  }
  return surfaces;
}

// The smaller root of x exp(-x) = response, by bisection: it rises up to x = 1.
double SmallestBend(double response) {
  double low = 0.0;
  double high = 1.0;
  while (high - low > 1e-12) {
    const double middle = 0.5 * (low + high);
    (middle * std::exp(-middle) < response ? low : high) = middle;
  }
  return high;
}

// One surface over its arc length.
class Curve {
 public:
  // Where beams lie closer than the noise of their ranges, the way from hit to hit goes back and
  // forth: it is measured between hits that are kMinStepM apart, evenly for those in between.
  Curve(const std::vector<ScanPoint>& points, const Surface& surface)
      : points_(points.begin() + static_cast<std::ptrdiff_t>(surface.begin),
                points.begin() + static_cast<std::ptrdiff_t>(surface.end)),
        arc_(points_.size(), 0.0),
        length_(points_.size(), 0.0) {
    std::size_t last = 0;
    for (std::size_t i = 1; i < points_.size(); ++i) {
      const double way = (points_[i].p_lidar - points_[last].p_lidar).norm();
      if (way < kMinStepM && i + 1 < points_.size()) continue;
      const double step = way / static_cast<double>(i - last);
      for (; last < i; ++last) {
        arc_[last + 1] = arc_[last] + step;
        length_[last] += 0.5 * step;
        length_[last + 1] += 0.5 * step;
      }
    }
  }

  std::size_t size() const { return points_.size(); }
  const ScanPoint& operator[](std::size_t i) const { return points_[i]; }
  double DistanceToEnd(std::size_t i) const { return std::min(arc_[i], arc_.back() - arc_[i]); }

  // 2 |A - α| / t at every hit. Each counts for the length of curve around it, so that where beams
  // lie closer is no heavier.
  std::vector<double> Bends(double scale) const {
    std::vector<double> bends(size());
    std::size_t first = 0;
    for (std::size_t i = 0; i < size(); ++i) {
      while (arc_[first] < arc_[i] - kReach * scale) ++first;
      Eigen::Vector2d sum = Eigen::Vector2d::Zero();
      double weights = 0.0;
      for (std::size_t j = first; j < size() && arc_[j] <= arc_[i] + kReach * scale; ++j) {
        const double u = (arc_[j] - arc_[i]) / scale;
        const double weight = length_[j] * std::exp(-0.5 * u * u);
        sum += weight * (points_[j].p_lidar - points_[i].p_lidar);
        weights += weight;
      }
      bends[i] = weights > 0.0 ? 2.0 * (sum / weights).norm() / scale : 0.0;
    }
    return bends;
  }

 private:
  std::vector<ScanPoint> points_;
  std::vector<double> arc_;     // From the first hit. [m]
  std::vector<double> length_;  // Half way to either neighbour. [m]
};

bool IsNew(const InterestPoint& point,
           const std::vector<InterestPoint>& found,
           const InterestPointOptions& options) {
  return std::none_of(found.begin(), found.end(), [&](const InterestPoint& other) {
    const double same = other.scale_m < point.scale_m ? point.scale_m : 0.0;
    return (other.p_lidar - point.p_lidar).norm() < std::max(options.min_separation_m, same);
  });
}

// Local maxima inside of a curve; of equal ones the first. Near its end a straight wall bends as
// well, x = 2 φ(d/t) / Φ(d/t) at distance d, above 0.93 within 0.6 t: noise alone makes maxima
// there.
void FindCorners(const Curve& curve,
                 double scale,
                 double min_bend,
                 const InterestPointOptions& options,
                 std::vector<InterestPoint>* found) {
  const std::vector<double> bends = curve.Bends(scale);
  for (std::size_t i = 1; i + 1 < curve.size(); ++i) {
    if (bends[i] < min_bend || !(bends[i] > bends[i - 1] && bends[i] >= bends[i + 1])) continue;
    if (curve.DistanceToEnd(i) < scale) continue;
    const InterestPoint point{curve[i].beam, curve[i].p_lidar, scale, false};
    if (IsNew(point, *found, options)) found->push_back(point);
  }
}

// The end of a surface bends as far as can be, x = 1.596, at every scale: found at the finest. A
// single hit may be half on one surface and half on another.
void FindEdges(const std::vector<ScanPoint>& points,
               const Surface& surface,
               const InterestPointOptions& options,
               std::vector<InterestPoint>* found) {
  if (surface.end - surface.begin < 2) return;
  const auto take = [&](const ScanPoint& inside, const ScanPoint& end, const ScanPoint& beyond) {
    if (!IsEdge(inside, end, beyond)) return;
    const InterestPoint point{end.beam, end.p_lidar, options.base_scale_m, true};
    if (IsNew(point, *found, options)) found->push_back(point);
  };
  const std::size_t first = surface.begin;
  const std::size_t last = surface.end - 1;
  if (first > 0) take(points[first + 1], points[first], points[first - 1]);
  if (last + 1 < points.size()) take(points[last - 1], points[last], points[last + 1]);
}

}  // namespace

Status InterestPointOptions::Validate() const {
  if (!(min_response > 0.0 && min_response < 1.0 / std::numbers::e)) {
    return InvalidArgument("min_response {}, expected in (0, 1/e)", min_response);
  }
  if (!(min_separation_m >= 0.0) || !(max_gap_m > 0.0)) {
    return InvalidArgument(
        "min_separation_m {} and max_gap_m {}, expected >= 0 and > 0", min_separation_m, max_gap_m);
  }
  if (!(base_scale_m > 0.0) || !(scale_step > 1.0) || scales < 1) {
    return InvalidArgument("base_scale_m {}, scale_step {}, scales {}, expected > 0, > 1, >= 1",
                           base_scale_m,
                           scale_step,
                           scales);
  }
  return OkStatus();
}

std::vector<InterestPoint> DetectInterestPoints(std::span<const double> ranges_m,
                                                const LidarSensor& sensor,
                                                const InterestPointOptions& options) {
  const std::vector<ScanPoint> points = ScanPoints(ranges_m, sensor);
  const std::vector<Surface> surfaces = FindSurfaces(points, options.max_gap_m);
  std::vector<Curve> curves;
  for (const Surface& surface : surfaces) {
    curves.emplace_back(points, surface);
  }
  const double min_bend = SmallestBend(options.min_response);
  std::vector<InterestPoint> found;
  double scale = options.base_scale_m;
  for (int k = 0; k < options.scales; ++k, scale *= options.scale_step) {
    for (const Curve& curve : curves) FindCorners(curve, scale, min_bend, options, &found);
    if (k > 0 || !options.edges) continue;
    for (const Surface& surface : surfaces) FindEdges(points, surface, options, &found);
  }
  std::sort(found.begin(), found.end(), [](const InterestPoint& a, const InterestPoint& b) {
    return a.beam < b.beam;
  });
  return found;
}

}  // namespace shiftmap

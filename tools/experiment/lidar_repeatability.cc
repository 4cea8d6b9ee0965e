// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/lidar_repeatability.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "tools/experiment/dice.h"

namespace shiftmap {
namespace {

constexpr std::array kFinders = {"flirt", "range gradient", "random"};
constexpr std::array kDistances = {0.0, 0.5, 1.0, 2.0, 4.0};  // [m]

using Points = std::vector<Eigen::Vector2d>;  // Lidar frame. [m]

struct Posed {
  Se2 T_map_lidar;
  const std::vector<double>* ranges_m = nullptr;
  std::vector<ScanPoint> returns;  // Within max_point_range_m.
  std::array<Points, kFinders.size()> points;
};

// The first `count` of the candidates, of two that are close the earlier.
Points TakeApart(const std::vector<const ScanPoint*>& candidates, std::size_t count, double apart) {
  Points points;
  for (const ScanPoint* candidate : candidates) {
    if (points.size() == count) break;
    const Eigen::Vector2d& p = candidate->p_lidar;
    if (std::none_of(points.begin(), points.end(), [&](const Eigen::Vector2d& other) {
          return (other - p).norm() < apart;
        })) {
      points.push_back(p);
    }
  }
  return points;
}

Points GradientPoints(const std::vector<ScanPoint>& returns, std::size_t count, double apart) {
  std::vector<std::pair<double, const ScanPoint*>> jumps;
  for (std::size_t i = 1; i < returns.size(); ++i) {
    const ScanPoint& a = returns[i - 1];
    const ScanPoint& b = returns[i];
    if (b.beam != a.beam + 1) continue;
    jumps.emplace_back(std::abs(b.range_m - a.range_m), b.range_m < a.range_m ? &b : &a);
  }
  std::stable_sort(
      jumps.begin(), jumps.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<const ScanPoint*> candidates;
  for (const auto& [jump, point] : jumps) candidates.push_back(point);
  return TakeApart(candidates, count, apart);
}

Points RandomPoints(const std::vector<ScanPoint>& returns,
                    std::size_t count,
                    double apart,
                    Dice* dice) {
  std::vector<const ScanPoint*> candidates;
  for (const ScanPoint& point : returns) candidates.push_back(&point);
  for (std::size_t i = candidates.size(); i > 1; --i) {
    const auto j = static_cast<std::size_t>(dice->Uniform(0.0, static_cast<double>(i)));
    std::swap(candidates[i - 1], candidates[j]);
  }
  return TakeApart(candidates, count, apart);
}

Posed FindAll(const Se2& T_map_vehicle,
              const RangeScan& scan,
              const LidarFrontEndOptions& options,
              Dice* dice) {
  Posed posed{T_map_vehicle * options.sensor.T_vehicle_lidar, &scan.ranges_m, {}, {}};
  for (const ScanPoint& point : ScanPoints(scan.ranges_m, options.sensor)) {
    if (point.range_m <= options.max_point_range_m) posed.returns.push_back(point);
  }
  for (const InterestPoint& point :
       DetectInterestPoints(scan.ranges_m, options.sensor, options.points)) {
    if (point.p_lidar.norm() <= options.max_point_range_m) posed.points[0].push_back(point.p_lidar);
  }
  const std::size_t count = posed.points[0].size();
  const double apart = options.points.min_separation_m;
  posed.points[1] = GradientPoints(posed.returns, count, apart);
  posed.points[2] = RandomPoints(posed.returns, count, apart, dice);
  return posed;
}

// Whether the scan would have seen a point of its own frame.
bool InView(const Eigen::Vector2d& q, const Posed& scan, const RepeatabilityOptions& options) {
  const LidarSensor& sensor = options.front_end.sensor;
  const double range = q.norm();
  if (range > options.front_end.max_point_range_m) return false;
  const auto beams = static_cast<double>(scan.ranges_m->size());
  const double share = std::atan2(q.y(), q.x()) / sensor.field_of_view_rad + 0.5;
  if (share < 0.0 || share > 1.0) return false;
  const auto nearest = static_cast<std::ptrdiff_t>(std::lround(share * (beams - 1.0)));
  double seen = 0.0;
  for (std::ptrdiff_t beam = nearest - 1; beam <= nearest + 1; ++beam) {
    if (beam < 0 || beam >= std::ssize(*scan.ranges_m)) continue;
    const double beam_range = (*scan.ranges_m)[static_cast<std::size_t>(beam)];
    seen = std::max(seen, sensor.Returned(beam_range) ? beam_range : 0.0);
  }
  return seen > range - options.occluded_by_m;
}

double Overlap(const Posed& first, const Posed& second, const RepeatabilityOptions& options) {
  if (first.returns.empty()) return 0.0;
  const Se2 T_second_first = second.T_map_lidar.Inverse() * first.T_map_lidar;
  const auto in_view =
      std::count_if(first.returns.begin(), first.returns.end(), [&](const ScanPoint& point) {
        return InView(T_second_first * point.p_lidar, second, options);
      });
  return static_cast<double>(in_view) / static_cast<double>(first.returns.size());
}

void Count(const Posed& first,
           const Posed& second,
           std::size_t finder,
           const RepeatabilityOptions& options,
           Repeatability* result) {
  const Se2 T_second_first = second.T_map_lidar.Inverse() * first.T_map_lidar;
  ++result->pairs;
  for (const Eigen::Vector2d& point : first.points[finder]) {
    const Eigen::Vector2d q = T_second_first * point;
    if (!InView(q, second, options)) continue;
    ++result->in_view;
    double nearest = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector2d& other : second.points[finder]) {
      nearest = std::min(nearest, (other - q).norm());
    }
    if (nearest > options.found_within_m) continue;
    ++result->found;
    result->squares_m2 += nearest * nearest;
  }
}

}  // namespace

double Repeatability::Share() const {
  return in_view > 0 ? static_cast<double>(found) / static_cast<double>(in_view)
                     : std::numeric_limits<double>::quiet_NaN();
}

double Repeatability::RmsDistance() const {
  return found > 0 ? std::sqrt(squares_m2 / static_cast<double>(found))
                   : std::numeric_limits<double>::quiet_NaN();
}

StatusOr<std::vector<Repeatability>> MeasureRepeatability(const LidarLog& log,
                                                          const RepeatabilityOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.front_end.Validate());
  if (log.poses.size() != log.scans.size()) {
    return InvalidArgument("file '{}': {} poses and {} scans, expected one for each",
                           log.name,
                           log.poses.size(),
                           log.scans.size());
  }
  Dice dice(options.seed);
  std::vector<Posed> scans;
  for (std::size_t i = 0; i < log.scans.size(); ++i) {
    scans.push_back(FindAll(log.poses[i].T_map_vehicle, log.scans[i], options.front_end, &dice));
  }
  std::vector<Repeatability> results;
  for (const char* finder : kFinders) {
    for (std::size_t bin = 0; bin + 1 < kDistances.size(); ++bin) {
      results.push_back({finder, kDistances[bin], kDistances[bin + 1]});
    }
  }
  for (const Posed& first : scans) {
    for (const Posed& second : scans) {
      const double distance =
          (second.T_map_lidar.translation() - first.T_map_lidar.translation()).norm();
      if (&first == &second || distance >= options.max_distance_m) continue;
      if (Overlap(first, second, options) < options.min_overlap) continue;
      for (std::size_t i = 0; i < results.size(); ++i) {
        Repeatability& result = results[i];
        if (distance < result.min_distance_m || distance >= result.max_distance_m) continue;
        Count(first, second, i / (kDistances.size() - 1), options, &result);
      }
    }
  }
  return results;
}

}  // namespace shiftmap

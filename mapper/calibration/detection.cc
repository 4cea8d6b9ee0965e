// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/detection.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "mapper/state/sightings.h"
#include "mapstore/core/quantile.h"

namespace shiftmap {
namespace {

constexpr double kFieldOfViewQuantile = 0.99;

// Where a run's groups stand, asked in the order of time.
class StandingModes {
 public:
  StandingModes(const BuildState& build, const BuildRun& run)
      : run_(run), mode_of_(build.modes.size(), kUnassigned) {}

  void GoTo(Stamp stamp) {
    const std::vector<MappingVisit>& visits = run_.data->visits;
    for (; next_ < visits.size() && visits[next_].begin <= stamp; ++next_) {
      if (run_.assignment[next_] == kUnassigned) continue;
      mode_of_[static_cast<std::size_t>(visits[next_].group)] = run_.assignment[next_];
    }
  }

  bool Stands(const ModeGrid::Entry& entry) const {
    return mode_of_[static_cast<std::size_t>(entry.group)] == entry.mode;
  }

 private:
  const BuildRun& run_;
  std::vector<int> mode_of_;
  std::size_t next_ = 0;
};

bool InFieldOfView(const SensorCalibration& sensor, const Eigen::Vector2d& p_vehicle_landmark) {
  const Eigen::Vector2d& q = p_vehicle_landmark;
  return q.squaredNorm() <= sensor.max_range_m * sensor.max_range_m &&
         std::abs(std::atan2(q.y(), q.x())) <= sensor.max_bearing_rad;
}

}  // namespace

ModeGrid GridOf(const BuildState& build, double cell_m) {
  ModeGrid grid(cell_m);
  for (std::size_t group = 0; group < build.modes.size(); ++group) {
    for (std::size_t k = 0; k < build.modes[group].size(); ++k) {
      const Eigen::Vector2d& position = build.modes[group][k].p_map_landmark;
      grid.Add({static_cast<int>(group), static_cast<int>(k), position});
    }
  }
  return grid;
}

void CountDetections(const BuildState& build,
                     const SensorCalibration& sensor,
                     const ModeGrid& grid,
                     const BuildRun& run,
                     DetectionCount* count) {
  StandingModes standing(build, run);
  std::vector<int> seen_at(build.modes.size(), -1);  // The last frame of each group.
  for (std::size_t f = 0; f < run.data->frames.size(); ++f) {
    const KeyFrame& frame = run.data->frames[f];
    standing.GoTo(frame.stamp);
    const auto now = static_cast<int>(f);
    int all_seen = 0;
    for (int s = frame.first_sighting; s < frame.first_sighting + frame.sighting_count; ++s) {
      const Sighting& sighting = run.data->sightings[static_cast<std::size_t>(s)];
      const auto visit = static_cast<std::size_t>(sighting.visit);
      if (!IsInlier(build, run, sighting)) continue;
      int& at = seen_at[static_cast<std::size_t>(run.data->visits[visit].group)];
      all_seen += at != now ? 1 : 0;
      at = now;
    }
    const Se2 T_vehicle_map = run.poses[f].Inverse();
    const Eigen::Vector2d p_map_vehicle = run.poses[f].translation();
    grid.VisitNear(p_map_vehicle, sensor.max_range_m, [&](const ModeGrid::Entry& entry) {
      const int seen = seen_at[static_cast<std::size_t>(entry.group)] == now ? 1 : 0;
      if (all_seen - seen == 0 || !standing.Stands(entry)) return;
      if (!InFieldOfView(sensor, T_vehicle_map * entry.p_map_landmark)) return;
      count->expected += 1.0;
      count->detected += seen;
    });
  }
}

void SetFieldOfView(const std::vector<Eigen::Vector2d>& positions, SensorCalibration* sensor) {
  std::vector<double> ranges;
  std::vector<double> bearings;
  for (const Eigen::Vector2d& q : positions) {
    ranges.push_back(q.norm());
    bearings.push_back(std::abs(std::atan2(q.y(), q.x())));
  }
  sensor->max_range_m = std::max(0.1, Quantile(ranges, kFieldOfViewQuantile));
  sensor->max_bearing_rad = std::max(0.01, Quantile(bearings, kFieldOfViewQuantile));
}

void SetDetection(const DetectionCount& count, SensorCalibration* sensor) {
  sensor->detection_probability =
      std::clamp((count.detected + 1.0) / (count.expected + 2.0), 0.05, 0.95);
}

SensorCalibration EstimateDetection(const BuildState& build, const ModeOptions& options) {
  SensorCalibration sensor = build.sensor;
  std::vector<Eigen::Vector2d> positions;
  int outliers = 0;
  for (const BuildRun& run : build.runs) {
    for (const Sighting& sighting : run.data->sightings) {
      if (!IsInlier(build, run, sighting)) {
        ++outliers;
        continue;
      }
      positions.push_back(sighting.observation.PositionInVehicle());
    }
  }
  if (static_cast<int>(positions.size()) < options.min_sightings) return sensor;
  SetFieldOfView(positions, &sensor);

  DetectionCount count;
  double frames = 0.0;
  const ModeGrid grid = GridOf(build, sensor.max_range_m);
  for (const BuildRun& run : build.runs) {
    CountDetections(build, sensor, grid, run, &count);
    frames += static_cast<double>(run.data->frames.size());
  }
  SetDetection(count, &sensor);
  const double area = sensor.max_bearing_rad * sensor.max_range_m * sensor.max_range_m;
  sensor.clutter_density_per_m2 = std::clamp((outliers + 1.0) / (frames * area), 1e-7, 1e-2);
  return sensor;
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/detection.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "localizer/models/own_field_of_view.h"
#include "mapper/state/sightings.h"
#include "mapstore/core/quantile.h"

namespace shiftmap {
namespace {

// The field of view holds this share of the sightings: the others are misreadings or chance.
constexpr double kFieldOfViewQuantile = 0.99;
constexpr double kMinRangeM = 0.1;
constexpr double kMinBearingRad = 0.01;

// Between one outlier in days of driving, and one in every scan of a room.
constexpr double kMinClutterPerM2 = 1e-7;
constexpr double kMaxClutterPerM2 = 1e-2;

// Where a run's groups stand, asked in the order of time.
class StandingModes {
 public:
  StandingModes(const BuildState& build, const BuildRun& run)
      : run_(run), mode_of_(build.modes.size()) {}

  void GoTo(Stamp stamp) {
    const auto& visits = run_.data->visits;
    for (; next_ < visits.end_index() && visits[next_].begin <= stamp; ++next_) {
      if (run_.assignment[next_]) mode_of_[visits[next_].group] = run_.assignment[next_];
    }
  }

  bool Stands(const ModeGrid::Entry& entry) const {
    return mode_of_[GroupIndex(entry.group)] == GroupModeIndex(entry.mode);
  }

 private:
  const BuildRun& run_;
  IndexedVector<GroupIndex, OptionalMode> mode_of_;
  VisitIndex next_;
};

}  // namespace

ModeGrid GridOf(const BuildState& build, double cell_m) {
  ModeGrid grid(cell_m);
  for (const GroupIndex group : build.modes.indices()) {
    const GroupModes& modes = build.modes[group];
    for (const GroupModeIndex mode : modes.indices()) {
      grid.Add({group.value(), mode.value(), modes[mode].p_map_landmark});
    }
  }
  return grid;
}

Sector OwnSector(const BuildState& build, const SensorCalibration& sensor, const BuildRun& run) {
  OwnFieldOfView own(sensor);
  for (const Sighting& sighting : run.data->sightings) {
    if (IsInlier(build, run, sighting)) own.Add(sighting.observation.PositionInVehicle());
  }
  return own.MakeSector();
}

void CountDetections(const BuildState& build,
                     const SensorCalibration& sensor,
                     const ModeGrid& grid,
                     const BuildRun& run,
                     DetectionCount* count) {
  const Sector common = SectorOf(sensor);
  const Sector own = OwnSector(build, sensor, run);
  StandingModes standing(build, run);
  // The last frame of each group.
  IndexedVector<GroupIndex, std::optional<FrameIndex>> seen_at(build.modes.size());
  for (const FrameIndex now : run.data->frames.indices()) {
    const KeyFrame& frame = run.data->frames[now];
    standing.GoTo(frame.stamp);
    int all_seen = 0;
    for (const SightingIndex s : frame.sightings()) {
      const Sighting& sighting = run.data->sightings[s];
      if (!IsInlier(build, run, sighting)) continue;
      std::optional<FrameIndex>& at = seen_at[run.data->visits[sighting.visit].group];
      all_seen += at != now ? 1 : 0;
      at = now;
    }
    const Se2 T_vehicle_map = run.poses[now].Inverse();
    const Eigen::Vector2d p_map_vehicle = run.poses[now].translation();
    grid.VisitNear(p_map_vehicle, own.max_range_m, [&](const ModeGrid::Entry& entry) {
      const int seen = seen_at[GroupIndex(entry.group)] == now ? 1 : 0;
      if (all_seen - seen == 0 || !standing.Stands(entry)) return;
      const Eigen::Vector2d q = T_vehicle_map * entry.p_map_landmark;
      if (!common.Contains(q) || !own.Contains(q)) return;
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
  sensor->max_range_m = std::max(kMinRangeM, Quantile(ranges, kFieldOfViewQuantile));
  sensor->max_bearing_rad = std::max(kMinBearingRad, Quantile(bearings, kFieldOfViewQuantile));
}

void SetDetection(const DetectionCount& count, SensorCalibration* sensor) {
  sensor->detection_probability =
      std::clamp((count.detected + 1.0) / (count.expected + 2.0), kMinDetection, kMaxDetection);
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
  if (std::ssize(positions) < options.min_sightings) return sensor;
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
  sensor.clutter_density_per_m2 =
      std::clamp((outliers + 1.0) / (frames * area), kMinClutterPerM2, kMaxClutterPerM2);
  return sensor;
}

}  // namespace shiftmap

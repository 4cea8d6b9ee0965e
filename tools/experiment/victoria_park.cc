// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/victoria_park.h"

#include <cmath>
#include <ctime>
#include <optional>
#include <utility>

#include "localizer/models/motion_model.h"
#include "mapstore/core/median.h"
#include "tools/experiment/processor_time.h"

namespace shiftmap {
namespace {

constexpr int kAlignmentRounds = 20;
constexpr double kMediansThatCount = 4.0;

// Between poses the truck keeps its curvature well enough for as long.
constexpr double kMaxGapSeconds = 2.5;

}  // namespace

StatusOr<GpsScore> ScoreAgainstGps(std::span<const StampedPose> trajectory,
                                   std::span<const GpsFix> fixes,
                                   const Eigen::Vector2d& p_vehicle_antenna) {
  std::vector<PointPair> all;
  for (const GpsFix& fix : fixes) {
    const std::optional<Se2> pose = Interpolate(trajectory, fix.stamp, FromSeconds(kMaxGapSeconds));
    if (pose) all.push_back({fix.p_gps_antenna, *pose * p_vehicle_antenna});
  }
  GpsScore score;
  std::vector<PointPair> used = all;
  for (int round = 0; round < kAlignmentRounds; ++round) {
    SHIFTMAP_ASSIGN_OR_RETURN(score.T_gps_start, AlignRigid2d(used));
    std::vector<double> distances;
    for (const PointPair& pair : all) {
      distances.push_back((pair.p_a - score.T_gps_start * pair.p_b).norm());
    }
    score.median_m = Median(distances);
    used.clear();
    double squares = 0.0;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (distances[i] > kMediansThatCount * score.median_m) continue;
      used.push_back(all[i]);
      squares += distances[i] * distances[i];
    }
    score.rmse_m = std::sqrt(squares / static_cast<double>(used.size()));
    score.used_share = static_cast<double>(used.size()) / static_cast<double>(all.size());
  }
  return score;
}

std::vector<StampedPose> DeadReckonScans(const Run& run, const OdometryCalibration& odometry) {
  std::vector<StampedPose> trajectory;
  std::size_t hint = 0;
  for (const Scan& scan : run.scans) {
    Se2 pose;
    if (!trajectory.empty()) {
      const StampedPose& last = trajectory.back();
      pose = last.T_map_vehicle *
             IntegrateMotion(run.odometry, last.stamp, scan.stamp, odometry, &hint).T_begin_end;
    }
    trajectory.push_back({scan.stamp, pose});
  }
  return trajectory;
}

Run WithEveryScan(int n, const Run& run) {
  Run thinned{run.info, run.odometry, {}};
  for (std::size_t i = 0; i < run.scans.size(); i += static_cast<std::size_t>(n)) {
    thinned.scans.push_back(run.scans[i]);
  }
  return thinned;
}

ParkResult RunDeadReckoning(const Run& run, const Calibration& calibration) {
  const double begin = ProcessorSeconds();
  ParkResult result{.method = "dead reckoning"};
  result.trajectory = DeadReckonScans(run, calibration.odometry);
  result.cpu_s = ProcessorSeconds() - begin;
  return result;
}

ParkResult RunFilter(const Run& run, const MapperOptions& options, bool joint) {
  const double begin = ProcessorSeconds();
  AssociationOptions association = options.association;
  association.joint = joint;
  AnonymousAssociation found = AssociateAnonymous(run, options.calibration, association);
  ParkResult result{.method = joint ? "filter, joint" : "filter, nearest"};
  result.trajectory = std::move(found.trajectory);
  result.landmarks = std::move(found.tracks);
  result.observations = found.observations;
  result.associated = found.associated;
  result.cpu_s = ProcessorSeconds() - begin;
  return result;
}

StatusOr<ParkResult> RunMapper(const Run& run, const MapperOptions& options) {
  const double begin = ProcessorSeconds();
  MapperOptions associating = options;
  associating.association.associate = true;
  SHIFTMAP_ASSIGN_OR_RETURN(const MapperResult built,
                            BuildMap({{run.info.vehicle, "", run}}, std::nullopt, associating));
  ParkResult result{.method = "graph, joint"};
  result.trajectory = built.runs.front().trajectory;
  for (const Mode& landmark : built.content.anonymous_landmarks) {
    result.landmarks.push_back(landmark.p_map_landmark);
  }
  for (const Scan& scan : run.scans) {
    result.observations += static_cast<int>(scan.observations.size());
  }
  result.associated = built.runs.front().observations;
  result.cpu_s = ProcessorSeconds() - begin;
  return result;
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/mapped_run.h"

#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"
#include "mapper/state/sightings.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {

Se2 PoseAtBegin(std::span<const OdometrySample> odometry,
                const OdometryCalibration& calibration,
                Stamp scan,
                const Se2& T_map_vehicle) {
  const Stamp begin = odometry.front().stamp;
  if (scan <= begin) return T_map_vehicle;
  std::size_t hint = 0;
  const MotionIncrement motion = IntegrateMotion(odometry, begin, scan, calibration, &hint);
  return T_map_vehicle * motion.T_begin_end.Inverse();
}

Se2 StartPose(const BuildRun& run) {
  return PoseAtBegin(
      run.data->odometry, run.odometry, run.data->frames.front().stamp, run.poses.front());
}

void AnchorFrame(BuildState* build) { MoveBuild(StartPose(build->runs.front()).Inverse(), build); }

MappedRun MakeMappedRun(const BuildState& build, RunIndex index) {
  const BuildRun& run = build.runs[index];
  MappedRun mapped;
  mapped.name = run.data->name;
  mapped.sha256 = run.data->sha256;
  mapped.uuid = run.data->info.uuid;
  mapped.vehicle = run.data->info.vehicle;
  mapped.begin = run.data->begin;
  mapped.end = run.data->end;
  mapped.poses = static_cast<int>(run.poses.size());
  mapped.observations = static_cast<int>(run.data->sightings.size());
  mapped.duplicate_observations = run.data->duplicate_observations;
  mapped.near_observations = run.data->near_observations;
  mapped.anonymous_observations = run.data->anonymous_observations;
  mapped.odometry = run.odometry;
  mapped.sensor_bias = run.sensor_bias;
  mapped.variance_factor = run.variance_factor;
  for (const FrameIndex f : run.poses.indices()) {
    mapped.trajectory.push_back({run.data->frames[f].stamp, run.poses[f]});
  }
  for (const Sighting& sighting : run.data->sightings) {
    if (!IsInlier(build, run, sighting)) {
      ++mapped.outliers;
      continue;
    }
    const Innovation innovation =
        SightingInnovation(run, sighting, AssignedPosition(build, run, sighting));
    mapped.chi2 +=
        SquaredMahalanobis(innovation.nu, ObservationNoise(sighting.observation, build.sensor));
  }
  mapped.T_map_start = StartPose(run);
  for (const FrameIndex motion : BrokenMotions(run.motions)) {
    mapped.moved.push_back(run.data->frames[motion].stamp);
  }
  return mapped;
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/ekf_slam.h"

#include <Eigen/LU>
#include <algorithm>
#include <cstddef>

#include "localizer/models/observation_model.h"
#include "mapper/frontend/gated_landmarks.h"
#include "mapper/frontend/slam_state.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

PoseWithCovariance PoseOf(const SlamState& state) { return {state.pose(), state.PoseCovariance()}; }

// A pose of the filter, before its sightings and with them.
struct Step {
  Eigen::Matrix3d F = Eigen::Matrix3d::Identity();  // dξ / dξ of the pose before.
  PoseWithCovariance predicted;
  PoseWithCovariance filtered;
};

// What a run's sightings read, without what the sensor gets wrong.
IndexedVector<SightingIndex, Observation> CorrectedObservations(const MappingRun& run,
                                                                const SensorCalibration& sensor) {
  IndexedVector<SightingIndex, Observation> observations;
  for (const Sighting& sighting : run.sightings) {
    observations.push_back(Corrected(sighting.observation, sensor));
  }
  return observations;
}

// Per sighting, whether another of its visit says the same, by odometry and the sensor's noise. All
// of them where landmarks are mostly seen in passing: one sighting has to do then.
// @param observations  Of the sightings, corrected.
IndexedVector<SightingIndex, bool> ConfirmedSightings(
    const MappingRun& run,
    const IndexedVector<SightingIndex, Observation>& observations,
    const FrameMotions& motions,
    const SensorCalibration& sensor) {
  // Sightings before and after that are asked: one of them may be misread itself.
  constexpr std::size_t kNeighbours = 2;
  constexpr double kFloor = 0.1;  // Of odometry meanwhile. [m]
  static const double gate = ChiSquareQuantile(0.999, 2);
  const IndexedVector<FrameIndex, Se2> poses = DeadReckon(motions);
  IndexedVector<SightingIndex, bool> confirmed(run.sightings.size());
  for (const MappingVisit& visit : run.visits) {
    std::vector<Eigen::Vector2d> positions;
    std::vector<double> variances;
    for (const SightingIndex s : visit.sightings) {
      const Observation& observation = observations[s];
      positions.push_back(poses[run.sightings[s].frame] * observation.PositionInVehicle());
      variances.push_back(
          PositionNoiseInVehicle(observation, ObservationNoise(observation, sensor)).trace());
    }
    for (std::size_t i = 0; i < positions.size(); ++i) {
      for (std::size_t j = i + 1; j < std::min(positions.size(), i + 1 + kNeighbours); ++j) {
        const double variance = variances[i] + variances[j] + kFloor * kFloor;
        if ((positions[i] - positions[j]).squaredNorm() > gate * variance) continue;
        confirmed[visit.sightings[i]] = true;
        confirmed[visit.sightings[j]] = true;
      }
    }
  }
  const auto count = std::count(confirmed.begin(), confirmed.end(), true);
  if (2 * count < std::ssize(confirmed)) confirmed.assign(confirmed.size(), true);
  return confirmed;
}

// No pose is more certain than that, so that its covariance has an inverse. [m], [rad]
constexpr double kMinPoseSd = 1e-5;

// The smoother of Rauch, Tung and Striebel over the poses by themselves, without what they have in
// common with landmarks.
std::vector<Se2> Smoothed(const std::vector<Step>& steps) {
  std::vector<Se2> poses;
  for (const Step& step : steps) poses.push_back(step.filtered.T_map_vehicle);
  for (std::size_t i = steps.size(); i-- > 1;) {
    const PoseWithCovariance& predicted = steps[i].predicted;
    Eigen::Matrix3d cov = predicted.cov_T_map_vehicle;
    cov.diagonal().array() += kMinPoseSd * kMinPoseSd;
    const Eigen::Matrix3d gain =
        steps[i - 1].filtered.cov_T_map_vehicle * steps[i].F.transpose() * cov.inverse();
    const Eigen::Vector3d change = (predicted.T_map_vehicle.Inverse() * poses[i]).Log();
    poses[i - 1] = poses[i - 1] * Se2::Exp(gain * change);
  }
  return poses;
}

}  // namespace

std::vector<Se2> EstimateTrajectoryByEkf(const MappingRun& run,
                                         const FrameMotions& motions,
                                         const Calibration& calibration) {
  SlamState state(calibration);
  GatedLandmarks landmarks;
  std::vector<Step> steps;
  const auto observations = CorrectedObservations(run, calibration.sensor);
  const auto confirmed = ConfirmedSightings(run, observations, motions, calibration.sensor);
  for (const FrameIndex i : run.frames.indices()) {
    const KeyFrame& frame = run.frames[i];
    Step& step = steps.emplace_back();
    if (i > 0) {
      const MotionIncrement motion = MotionFrom(motions, i - 1, state.Odometry());
      step.F = motion.T_begin_end.InverseAdjoint();
      state.Predict(motion);
    }
    step.predicted = PoseOf(state);
    for (const SightingIndex s : frame.sightings()) {
      if (!confirmed[s]) continue;
      const Observation& observation = observations[s];
      state.Focus(observation.PositionInVehicle().norm());
      const GroupIndex group = run.visits[run.sightings[s].visit].group;
      landmarks.Observe(group.value(), observation, &state);
    }
    step.filtered = PoseOf(state);
  }
  return Smoothed(steps);
}

}  // namespace shiftmap

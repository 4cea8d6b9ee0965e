// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/ekf_slam.h"

#include <Eigen/LU>
#include <algorithm>
#include <cstddef>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapper/frontend/gated_landmarks.h"
#include "mapper/frontend/slam_state.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// A pose of the filter, before its sightings and with them.
struct Step {
  Eigen::Matrix3d F = Eigen::Matrix3d::Identity();  // dξ / dξ of the pose before.
  PoseWithCovariance predicted;
  PoseWithCovariance filtered;
};

// Where a run's sightings put landmarks from the vehicle, without what the sensor gets wrong. To a
// vehicle that comes back metres beside where it takes itself to be, a bearing is not linear in its
// error, and a position is.
IndexedVector<SightingIndex, Observation> PositionObservations(const MappingRun& run,
                                                               const SensorCalibration& sensor) {
  IndexedVector<SightingIndex, Observation> positions;
  for (const Sighting& sighting : run.sightings) {
    const Observation read = Corrected(sighting.observation, sensor);
    Observation position = read;
    position.kind = Observation::Kind::kCartesian;
    position.z = read.PositionInVehicle();
    position.cov_z = PositionNoiseInVehicle(read, ObservationNoise(read, sensor));
    positions.push_back(std::move(position));
  }
  return positions;
}

// Per sighting, whether another of its visit says the same, by odometry and the sensor's noise. All
// of them where landmarks are mostly seen in passing: one sighting has to do then.
// @param observations  Of the sightings, positions.
IndexedVector<SightingIndex, bool> ConfirmedSightings(
    const MappingRun& run,
    const IndexedVector<SightingIndex, Observation>& observations,
    const FrameMotions& motions) {
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
      positions.push_back(poses[run.sightings[s].frame] * observations[s].z);
      variances.push_back(observations[s].cov_z->trace());
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

// The smoother of Rauch, Tung and Striebel over the poses.
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

// Corrects a pose by a landmark that stands at `place`, unless it does not gate: then it moved, or
// was misread.
void CorrectBy(const Observation& observation,
               const Eigen::Vector2d& place,
               PoseWithCovariance* pose) {
  constexpr double kPlaceSd = 0.3;  // Of where the filter left landmarks, to each other. [m]
  static const double gate = ChiSquareQuantile(0.999, 2);
  const Innovation innovation = Linearize(observation, pose->T_map_vehicle, place);
  const Eigen::Matrix<double, 3, 2> PHt = pose->cov_T_map_vehicle * innovation.H_pose.transpose();
  const Eigen::Matrix2d S = innovation.H_pose * PHt + *observation.cov_z +
                            kPlaceSd * kPlaceSd * Eigen::Matrix2d::Identity();
  if (!(SquaredMahalanobis(innovation.nu, S) <= gate)) return;
  const Eigen::Matrix<double, 3, 2> gain = PHt * S.inverse();
  pose->T_map_vehicle = pose->T_map_vehicle * Se2::Exp(gain * innovation.nu);
  pose->cov_T_map_vehicle = Symmetrized(pose->cov_T_map_vehicle - gain * PHt.transpose());
}

}  // namespace

std::vector<Se2> EstimateTrajectoryByEkf(const MappingRun& run,
                                         const FrameMotions& motions,
                                         const Calibration& calibration) {
  SlamState state(calibration);
  GatedLandmarks landmarks;
  const auto observations = PositionObservations(run, calibration.sensor);
  const auto confirmed = ConfirmedSightings(run, observations, motions);
  const auto for_confirmed = [&](FrameIndex i, const auto& use) {
    for (const SightingIndex s : run.frames[i].sightings()) {
      if (confirmed[s]) use(run.visits[run.sightings[s].visit].group.value(), observations[s]);
    }
  };
  for (const FrameIndex i : run.frames.indices()) {
    if (i > 0) state.Predict(MotionFrom(motions, i - 1, state.Odometry()));
    for_confirmed(i, [&](int group, const Observation& observation) {
      state.Focus(observation.z.norm());
      landmarks.Observe(group, observation, &state);
    });
  }
  state.Settle();
  std::vector<Step> steps;
  PoseWithCovariance pose;
  for (const FrameIndex i : run.frames.indices()) {
    Step& step = steps.emplace_back();
    if (i > 0) {
      const MotionIncrement motion = MotionFrom(motions, i - 1, state.Odometry());
      step.F = motion.T_begin_end.InverseAdjoint();
      pose = Moved(pose, motion);
    }
    step.predicted = pose;
    for_confirmed(i, [&](int group, const Observation& observation) {
      CorrectBy(observation, state.Position(landmarks.IdOf(group)), &pose);
    });
    step.filtered = pose;
  }
  return Smoothed(steps);
}

}  // namespace shiftmap

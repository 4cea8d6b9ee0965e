// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/ekf_slam.h"

#include "localizer/models/motion_model.h"
#include "mapper/frontend/gated_landmarks.h"
#include "mapper/frontend/slam_state.h"

namespace shiftmap {

std::vector<Se2> EstimateTrajectoryByEkf(const MappingRun& run, const Calibration& calibration) {
  std::vector<Se2> poses;
  SlamState state(calibration);
  GatedLandmarks landmarks;
  std::size_t hint = 0;
  for (std::size_t i = 0; i < run.frames.size(); ++i) {
    const KeyFrame& frame = run.frames[i];
    if (i > 0) {
      state.Predict(IntegrateMotion(
          run.odometry, run.frames[i - 1].stamp, frame.stamp, state.Odometry(), &hint));
    }
    for (int s = frame.first_sighting; s < frame.first_sighting + frame.sighting_count; ++s) {
      const Sighting& sighting = run.sightings[static_cast<std::size_t>(s)];
      state.Focus(sighting.observation.PositionInVehicle().norm());
      landmarks.Observe(
          run.visits[static_cast<std::size_t>(sighting.visit)].group, sighting.observation, &state);
    }
    poses.push_back(state.pose());
  }
  return poses;
}

std::vector<Se2> DeadReckon(const MappingRun& run, const OdometryCalibration& odometry) {
  std::vector<Se2> poses(1);
  std::size_t hint = 0;
  for (std::size_t i = 1; i < run.frames.size(); ++i) {
    const MotionIncrement motion = IntegrateMotion(
        run.odometry, run.frames[i - 1].stamp, run.frames[i].stamp, odometry, &hint);
    poses.push_back(poses.back() * motion.T_begin_end);
  }
  return poses;
}

}  // namespace shiftmap

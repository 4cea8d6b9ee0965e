// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/frame_motions.h"

#include <cmath>

namespace shiftmap {

Eigen::Vector3d CorrectionBetween(const OdometryCalibration& from, const OdometryCalibration& to) {
  return {std::log(to.scale_v / from.scale_v),
          std::log(to.scale_omega / from.scale_omega),
          to.lag_s - from.lag_s};
}

FrameMotions IntegrateMotions(const MappingRun& run, const OdometryCalibration& calibration) {
  FrameMotions motions{calibration, {}};
  std::size_t hint = 0;
  for (std::size_t i = 0; i + 1 < run.frames.size(); ++i) {
    motions.between_frames.push_back(IntegrateOdometry(
        run.odometry, run.frames[i].stamp, run.frames[i + 1].stamp, calibration, &hint));
  }
  return motions;
}

void UpdateMotions(const MappingRun& run,
                   const OdometryCalibration& calibration,
                   FrameMotions* motions) {
  const bool near = CorrectionBetween(motions->calibration, calibration).cwiseAbs().maxCoeff() <
                    kLinearCorrection;
  if (motions->between_frames.size() + 1 == run.frames.size() && near) return;
  *motions = IntegrateMotions(run, calibration);
}

MotionIncrement MotionFrom(const FrameMotions& motions,
                           std::size_t i,
                           const OdometryCalibration& calibration) {
  MotionIncrement motion =
      motions.between_frames[i].WithNoise(calibration.noise_v, calibration.noise_omega);
  const Eigen::Vector3d correction = CorrectionBetween(motions.calibration, calibration);
  motion.T_begin_end = motion.T_begin_end * Se2::Exp(motion.J_calibration * correction);
  return motion;
}

std::vector<Se2> DeadReckon(const FrameMotions& motions) {
  std::vector<Se2> poses(1);
  for (const IntegratedMotion& motion : motions.between_frames) {
    poses.push_back(poses.back() * motion.T_begin_end);
  }
  return poses;
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/frame_motions.h"

#include <cmath>

namespace shiftmap {
namespace {

// Variance per squared noise of odometry of a motion that tells nothing. [s]
constexpr double kNothing = 1e12;

}  // namespace

Eigen::Vector3d CorrectionBetween(const OdometryCalibration& from, const OdometryCalibration& to) {
  return {std::log(to.scale_v / from.scale_v),
          std::log(to.scale_omega / from.scale_omega),
          to.lag_s - from.lag_s};
}

FrameMotions IntegrateMotions(const MappingRun& run, const OdometryCalibration& calibration) {
  FrameMotions motions{calibration, {}};
  std::size_t hint = 0;
  for (FrameIndex i; i + 1 < run.frames.end_index(); ++i) {
    motions.between_frames.push_back(IntegrateOdometry(
        run.odometry, run.frames[i].stamp, run.frames[i + 1].stamp, calibration, &hint));
  }
  return motions;
}

void BreakMotion(FrameIndex i, FrameMotions* motions) {
  IntegratedMotion& motion = motions->between_frames[i];
  motion.J_calibration.setZero();
  motion.slip_s = kNothing;
  motion.cov_per_yaw_noise = Eigen::Vector3d(0.0, 0.0, kNothing).asDiagonal();
}

std::vector<FrameIndex> BrokenMotions(const FrameMotions& motions) {
  std::vector<FrameIndex> broken;
  for (const FrameIndex i : motions.between_frames.indices()) {
    if (motions.between_frames[i].slip_s == kNothing) broken.push_back(i);
  }
  return broken;
}

void UpdateMotions(const MappingRun& run,
                   const OdometryCalibration& calibration,
                   FrameMotions* motions) {
  const bool near = CorrectionBetween(motions->calibration, calibration).cwiseAbs().maxCoeff() <
                    kLinearCorrection;
  if (motions->between_frames.size() + 1 == run.frames.size() && near) return;
  const std::vector<FrameIndex> broken = BrokenMotions(*motions);
  *motions = IntegrateMotions(run, calibration);
  for (const FrameIndex i : broken) BreakMotion(i, motions);
}

MotionIncrement MotionFrom(const FrameMotions& motions,
                           FrameIndex i,
                           const OdometryCalibration& calibration) {
  MotionIncrement motion =
      motions.between_frames[i].WithNoise(calibration.noise_v, calibration.noise_omega);
  const Eigen::Vector3d correction = CorrectionBetween(motions.calibration, calibration);
  motion.T_begin_end = motion.T_begin_end * Se2::Exp(motion.J_calibration * correction);
  return motion;
}

IndexedVector<FrameIndex, Se2> DeadReckon(const FrameMotions& motions) {
  IndexedVector<FrameIndex, Se2> poses(1);
  for (const IntegratedMotion& motion : motions.between_frames) {
    poses.push_back(poses.back() * motion.T_begin_end);
  }
  return poses;
}

}  // namespace shiftmap

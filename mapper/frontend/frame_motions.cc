// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/frame_motions.h"

#include <cmath>
#include <cstddef>
#include <vector>

#include "mapper/frontend/smooth_odometry.h"

namespace shiftmap {
namespace {

// Variances of a motion that tells nothing. [m²], [rad²]
constexpr double kNothing = 1e8;

// Derivative of motions by the lag, without the noise of odometry. One sample long, so that the
// samples before and after an end weigh the same.
//
// Odometry is u = v + n with white noise n. The derivative of a motion Δ_i by the lag has the
// velocities at both ends of Δ_i. As measured, they have the noise N_i of Δ_i: the Jacobian would
// correlate with the residual and bias the lag. So its column J_i is E(∂Δ_i/∂lag | u), with
// SmoothOdometry(). Then E(Jᵀ W ∂Δ/∂lag) = E(Jᵀ W J), and the score has no bias: E(Jᵀ W N) =
// tr(W C) = 0, since W = Wᵀ and, n being stationary, C_ij = Cov(J_i, N_j) = -C_ji.
class ByLag {
 public:
  ByLag(const MappingRun& run, const OdometryCalibration& calibration)
      : odometry_(run.smooth_odometry),
        step_s_(SamplePeriod(run.odometry)),
        sooner_(calibration),
        later_(calibration) {
    sooner_.lag_s -= 0.5 * step_s_;
    later_.lag_s += 0.5 * step_s_;
  }

  Eigen::Vector3d Between(Stamp begin, Stamp end) {
    const auto motion = [&](const OdometryCalibration& calibration, std::size_t* hint) {
      return IntegrateOdometry(odometry_, begin, end, calibration, hint).T_begin_end;
    };
    const Se2 T_begin_sooner = motion(sooner_, &hint_sooner_);
    return (T_begin_sooner.Inverse() * motion(later_, &hint_later_)).Log() / step_s_;
  }

 private:
  const std::vector<OdometrySample>& odometry_;
  double step_s_;
  OdometryCalibration sooner_;
  OdometryCalibration later_;
  std::size_t hint_sooner_ = 0;
  std::size_t hint_later_ = 0;
};

}  // namespace

Eigen::Vector3d CorrectionBetween(const OdometryCalibration& from, const OdometryCalibration& to) {
  return {std::log(to.scale_v / from.scale_v),
          std::log(to.scale_omega / from.scale_omega),
          to.lag_s - from.lag_s};
}

FrameMotions IntegrateMotions(const MappingRun& run, const OdometryCalibration& calibration) {
  FrameMotions motions{calibration, {}};
  ByLag by_lag(run, calibration);
  std::size_t hint = 0;
  for (FrameIndex i; i + 1 < run.frames.end_index(); ++i) {
    const Stamp begin = run.frames[i].stamp;
    const Stamp end = run.frames[i + 1].stamp;
    IntegratedMotion motion = IntegrateOdometry(run.odometry, begin, end, calibration, &hint);
    motion.J_calibration.col(2) = by_lag.Between(begin, end);
    motions.between_frames.push_back(motion);
  }
  return motions;
}

void BreakMotion(FrameIndex i, FrameMotions* motions) {
  IntegratedMotion& motion = motions->between_frames[i];
  motion.J_calibration.setZero();
  motion.unknown_way = kNothing;
  motion.unknown_turn = kNothing;
}

std::vector<FrameIndex> BrokenMotions(const FrameMotions& motions) {
  std::vector<FrameIndex> broken;
  for (const FrameIndex i : motions.between_frames.indices()) {
    if (motions.between_frames[i].unknown_way == kNothing) broken.push_back(i);
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

IndexedVector<FrameIndex, Se2> DeadReckon(const MappingRun& run,
                                          const OdometryCalibration& calibration) {
  IndexedVector<FrameIndex, Se2> poses(1);
  std::size_t hint = 0;
  for (FrameIndex i; i + 1 < run.frames.end_index(); ++i) {
    const IntegratedMotion motion = IntegrateOdometry(
        run.odometry, run.frames[i].stamp, run.frames[i + 1].stamp, calibration, &hint);
    poses.push_back(poses.back() * motion.T_begin_end);
  }
  return poses;
}

}  // namespace shiftmap

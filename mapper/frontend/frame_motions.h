// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "localizer/models/motion_model.h"
#include "mapper/frontend/mapping_run.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/calibration.h"

namespace shiftmap {

/// The odometry of a run between its key frames, integrated at some calibration.
struct FrameMotions {
  OdometryCalibration calibration;
  IndexedVector<FrameIndex, IntegratedMotion> between_frames;  ///< One fewer than frames.
};

/// Standard deviation of a run's lag about that of the fleet: logs differ in what they call now.
/// [s]
inline constexpr double kLagSd = 0.2;

/// Motions are linear in the calibration as far as this from where they were integrated. [-], [s]
inline constexpr double kLinearCorrection = 1e-2;

/// The calibration `to` as a correction of `from`: (log scale_v, log scale_omega, lag_s).
Eigen::Vector3d CorrectionBetween(const OdometryCalibration& from, const OdometryCalibration& to);

FrameMotions IntegrateMotions(const MappingRun& run, const OdometryCalibration& calibration);

/// Makes the motion from frame i to the next tell nothing: the vehicle was moved otherwise.
void BreakMotion(FrameIndex i, FrameMotions* motions);

/// The motions that are broken, ascending.
std::vector<FrameIndex> BrokenMotions(const FrameMotions& motions);

/// The same, with what is broken, unless `motions` are near enough to `calibration` already.
void UpdateMotions(const MappingRun& run,
                   const OdometryCalibration& calibration,
                   FrameMotions* motions);

/// The motion from frame i to the next, corrected to a calibration nearby and with its noise.
MotionIncrement MotionFrom(const FrameMotions& motions,
                           FrameIndex i,
                           const OdometryCalibration& calibration);

/// Poses of key frames by motions alone, in the frame of the first one.
IndexedVector<FrameIndex, Se2> DeadReckon(const FrameMotions& motions);

/// The same by the odometry of a run at some calibration.
IndexedVector<FrameIndex, Se2> DeadReckon(const MappingRun& run,
                                          const OdometryCalibration& calibration);

}  // namespace shiftmap

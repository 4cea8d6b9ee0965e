// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "mapstore/core/stamp.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// The motion of a vehicle between two times as odometry tells it, with what is needed to correct
/// it for a change of calibration without integrating again.
struct MotionIncrement {
  Se2 T_begin_end;  ///< Pose of the vehicle at the end, in the vehicle frame at the begin.

  /// Of the perturbation T_begin_end·Exp(ξ), order (x, y, yaw), in the end frame. [m, m, rad]
  Eigen::Matrix3d cov = Eigen::Matrix3d::Zero();

  /// dξ / d(log scale_v, log scale_omega, lag_s). The lag column is zero where the motion is
  /// steady.
  Eigen::Matrix3d J_calibration = Eigen::Matrix3d::Zero();
};

/// Appends a stretch of constant velocity: the exact arc of SE(2), unlike the Euler step of T-IV
/// (28).
///
/// The error is a random walk in the vehicle frame: noise_v along x and, as slip, along y;
/// noise_omega in yaw. At standstill the wheels do not slip, and the noise is a hundredth of that
/// (in variance).
/// @param v_mps, omega_radps  As odometry measured them; the calibration's scales are applied here.
void AppendMotion(double v_mps,
                  double omega_radps,
                  Duration elapsed,
                  const OdometryCalibration& calibration,
                  MotionIncrement* increment);

/// Integrates odometry from `begin` to `end` >= begin. The velocity that holds at time t is that of
/// the newest sample at or before t - lag (the first sample, before it).
/// @param odometry  By non-decreasing stamp, not empty.
/// @param hint      In: where to start looking for `begin`, 0 if unknown. Out: where `end` was
/// found, the
///                  hint for an interval that starts there; a sequence of intervals is then linear
///                  in time.
MotionIncrement IntegrateMotion(std::span<const OdometrySample> odometry,
                                Stamp begin,
                                Stamp end,
                                const OdometryCalibration& calibration,
                                std::size_t* hint);

}  // namespace shiftmap

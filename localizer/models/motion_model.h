// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

#include "mapstore/core/stamp.h"
#include "mapstore/geometry/covariance.h"
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

  /// dξ / d(log scale_v, log scale_omega, lag_s). The lag column is zero here: it takes more
  /// of a log than the motion's (IntegrateMotions()).
  Eigen::Matrix3d J_calibration = Eigen::Matrix3d::Zero();

  bool measured = true;  ///< Odometry measured all of it, or the vehicle stood.
};

/// A pose moved on by a motion that is independent of it.
PoseWithCovariance Moved(const PoseWithCovariance& pose, const MotionIncrement& motion);

/// T-IV (28): a step along the heading at its begin, with noise of the pose along the map's axes.
/// @param Q  Of (x, y, yaw), per step. [m², m rad, rad²]
MotionIncrement EulerStep(const Se2& T_map_vehicle,
                          double v_mps,
                          double omega_radps,
                          double seconds,
                          const Eigen::Matrix3d& Q);

/// One motion after the other.
MotionIncrement Compose(const MotionIncrement& first, const MotionIncrement& second);

/// The way back: from where the motion ended to where it began.
MotionIncrement Inverse(const MotionIncrement& motion);

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

/// A motion whose noise is still open: its covariance is linear in the variances of v and omega.
struct IntegratedMotion {
  Se2 T_begin_end;                                          ///< As in MotionIncrement.
  Eigen::Matrix3d J_calibration = Eigen::Matrix3d::Zero();  ///< As in MotionIncrement.
  double slip_s = 0.0;  ///< Variance of x and of y per noise_v². [s]

  /// Covariance per noise_omega², order (x, y, yaw), in the end frame. [m²s, m·rad·s, rad²s]
  Eigen::Matrix3d cov_per_yaw_noise = Eigen::Matrix3d::Zero();

  /// What may have happened where odometry was silent: variance of x and of y [m²], and of yaw
  /// [rad²].
  double unknown_way = 0.0;
  double unknown_turn = 0.0;

  /// MotionIncrement::measured.
  bool Measured() const { return unknown_turn == 0.0; }

  MotionIncrement WithNoise(double noise_v, double noise_omega) const;
};

/// A recorded velocity that is older may have changed. [s]
inline constexpr double kOdometryFresh = 1.5;

/// A recorded sample of odometry holds for as long at most. [s]
inline constexpr double kOdometryHold = 2.0;

/// How a vehicle turns, and moves besides its way, where nothing measures it: random walk.
/// [rad/√s], [m/√s]
inline constexpr double kUnknownTurn = 0.5;

/// What a vehicle does while its log is silent, it does within as long. [s]
inline constexpr double kMaxSilence = 600.0;

/// Integrates recorded odometry from `begin` to `end` >= begin, as many calls of AppendMotion()
/// would, in a fraction of the time: see the source. The velocity that holds at time t is that of
/// the newest sample at or before t - lag (the first sample, before it).
///
/// Beyond kOdometryHold the vehicle is taken to stand, with the noise of one that moves for up to
/// kMaxSilence: it was parked, or its clock jumped, by years where a battery was empty. If it moved
/// before or after, it may from kOdometryFresh on have driven at that speed, and turned:
/// IntegratedMotion::unknown_way. The variances of the parts of a silence add up.
/// @param odometry  By non-decreasing stamp, not empty.
/// @param hint      In: where to start looking for `begin`, 0 if unknown. Out: where `end` was
///                  found, the hint for an interval that starts there; a sequence of intervals is
///                  then linear in time.
IntegratedMotion IntegrateOdometry(std::span<const OdometrySample> odometry,
                                   Stamp begin,
                                   Stamp end,
                                   const OdometryCalibration& calibration,
                                   std::size_t* hint);

/// The same with the noise of `calibration`.
MotionIncrement IntegrateMotion(std::span<const OdometrySample> odometry,
                                Stamp begin,
                                Stamp end,
                                const OdometryCalibration& calibration,
                                std::size_t* hint);

}  // namespace shiftmap

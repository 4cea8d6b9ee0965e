// SPDX-License-Identifier: Apache-2.0
//
// A mid-articulated loader: two bodies, an axle each, joined by a hinge between the axles.
#pragma once

#include "mapstore/geometry/se2.h"
#include "proto/core/status.h"
#include "tools/sim/odometry_motion.h"

namespace shiftmap {

struct LoaderOptions {
  double front_m = 1.5;                  ///< l_f, from the front axle to the hinge. > 0. [m]
  double rear_m = 1.7;                   ///< l_r, from the hinge to the rear axle. > 0. [m]
  double max_articulation_rad = 0.7;     ///< Either way; in (0, π/2). [rad]
  double max_articulation_radps = 0.35;  ///< Rate of the articulation, either way. > 0. [rad/s]
  double acceleration_mps2 = 0.8;        ///< Of the front axle, either way. > 0. [m/s²]

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// What the driver asks for.
struct LoaderCommand {
  double v_mps = 0.0;             ///< Of the front axle; negative backwards. [m/s]
  double articulation_rad = 0.0;  ///< [rad]
};

/// The vehicle frame is that of the front body: origin on its axle, x forward. The articulation γ
/// is the heading of the front body less that of the rear one. Axles do not slip sideways, so that
/// the front body turns at
///
///   ω = (v sin γ + l_r γ̇) / (l_f cos γ + l_r)
///
/// (P. Corke, P. Ridley: Steering kinematics for a center-articulated mobile robot, IEEE
/// Transactions on Robotics and Automation 17(2), 2001.) At constant γ it drives on a circle of
/// radius (l_f cos γ + l_r) / sin γ.
class Loader {
 public:
  explicit Loader(const LoaderOptions& options) : options_(options) {}

  double articulation_rad() const { return articulation_rad_; }
  double v_mps() const { return v_mps_; }

  /// Moves towards the command for `seconds`, within the limits of the loader. @return The velocity
  /// of the front body meanwhile, what exact odometry reports: speed at the end, yaw rate at the
  /// mean articulation.
  Velocity Step(const LoaderCommand& command, double seconds);

  /// ω. @param articulation_radps  γ̇.
  static double YawRate(const LoaderOptions& options,
                        double v_mps,
                        double articulation_rad,
                        double articulation_radps);

  /// γ that drives on a circle of curvature κ [1/m], bounded by the limit of the loader.
  static double ArticulationFor(const LoaderOptions& options, double curvature);

 private:
  LoaderOptions options_;
  double articulation_rad_ = 0.0;
  double v_mps_ = 0.0;
};

}  // namespace shiftmap

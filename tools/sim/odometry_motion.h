// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/geometry/se2.h"
#include "mapstore/map/calibration.h"
#include "tools/sim/random.h"

namespace shiftmap {

/// Velocity of a vehicle in its own frame.
struct Velocity {
  double v_mps = 0.0;        ///< Forward. [m/s]
  double omega_radps = 0.0;  ///< Counter-clockwise. [rad/s]
};

/// The true motion over an interval: the arc of the logged velocity, scaled, and disturbed by a
/// random walk in the vehicle frame. The lag is the caller's.
Se2 TrueMotion(const Velocity& logged,
               double seconds,
               const OdometryCalibration& odometry,
               Random* random);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap::rosbag2 {

/// The velocities that lead from each pose to the next on an arc, Log(T_i⁻¹ T_{i+1}) / Δt, each
/// held from its pose on; the last is held too. What the arc moves to the side is dropped. Of poses
/// with one stamp the last counts.
/// @param poses  In a frame that does not jump, by non-decreasing stamp.
/// @returns As many samples as there are stamps; one pose alone stands still.
std::vector<OdometrySample> OdometryOfPoses(std::span<const StampedPose> poses);

}  // namespace shiftmap::rosbag2

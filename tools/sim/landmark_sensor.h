// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <span>

#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"
#include "tools/sim/random.h"
#include "tools/sim/simulated_world.h"

namespace shiftmap {

/// Whether nothing stands between the vehicle and a point, map frame. [m]
using InSight = std::function<bool(const Eigen::Vector2d& p_map)>;

/// What a sensor that reads signatures sees: landmarks in its field of view and in sight, each with
/// the detection probability, as noisy range and bearing; and false observations, Poisson, uniform
/// over the field of view, with the signature of some landmark.
/// @param groups       Not empty if there is clutter.
/// @param active_mode  By group.
/// @param sensor       Its densities are not used.
/// @param in_sight     Empty where nothing stands in the way.
Scan SenseLandmarks(std::span<const SimulatedGroup> groups,
                    std::span<const ModeNumber> active_mode,
                    const StampedPose& pose,
                    const SensorCalibration& sensor,
                    double clutter_per_scan,
                    const InSight& in_sight,
                    Random* random);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapper/state/build_state.h"

namespace shiftmap {

/// Says which of a run's errors no working vehicle has, for a message; empty if none.
/// Odometry that counts backwards explains landmarks as well as a sensor that looks backwards does:
/// such a run fits itself, and bends the map. So does one whose odometry says nothing of the
/// heading, and it raises the noise of all runs of its vehicle. One whose bearings have the wrong
/// sign makes a map that is a mirror image, and one whose bearings are of no use one of nothing.
std::string ImplausibleCalibration(const PlausibilityOptions& options,
                                   const BuildRun& run,
                                   const SensorCalibration& sensor);

}  // namespace shiftmap

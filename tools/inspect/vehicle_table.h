// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/cli/context.h"
#include "mapstore/map/vehicle_calibration.h"

namespace shiftmap {

/// What a map knows of its vehicles, each value with its 95 % interval.
Json VehiclesJson(const std::vector<VehicleCalibration>& vehicles);

/// The same as a table.
std::string VehiclesText(const std::vector<VehicleCalibration>& vehicles);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/cli/context.h"
#include "mapstore/cli/text_style.h"
#include "mapstore/map/vehicle_calibration.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// What a map knows of its vehicles, each value with its 95 % interval.
Json VehiclesJson(const std::vector<VehicleCalibration>& vehicles);

/// The same as a table.
std::string VehiclesText(const std::vector<VehicleCalibration>& vehicles, const TextStyle& style);

/// Per vehicle that others judged the probability that it is broken.
Json TrustJson(const std::vector<VehicleTrust>& trust);

/// A line for each vehicle that is not believed.
std::string TrustText(const std::vector<VehicleTrust>& trust);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "mapstore/map/vehicle_calibration.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Writes the vehicles of a version.
Status InsertVehicleRows(Database& database,
                         std::int64_t version_id,
                         const std::vector<VehicleCalibration>& vehicles);

/// Appends them to `vehicles`, by name. That the numbers are right is for the content hash to say.
Status ReadVehicleRows(Database& database,
                       std::int64_t version_id,
                       std::vector<VehicleCalibration>& vehicles);

}  // namespace shiftmap

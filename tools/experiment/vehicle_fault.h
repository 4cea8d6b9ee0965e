// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/map/evidence.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// What is wrong with a vehicle, or who speaks for it.
enum class VehicleFault {
  kNone,
  kMisreadCodes,      ///< Perception takes the codes of landmarks for each other, in pairs.
  kFrozenOdometer,    ///< Says that the vehicle stands.
  kReversedOdometer,  ///< Says that it drives backwards.
  kFalseReports,      ///< Each shift, all that was visited is reported to be in another state.
  kFlood,             ///< The same in many reports, a few seconds each.
};

/// All of them, kNone first.
std::vector<VehicleFault> AllVehicleFaults();

/// A word for tables, e.g. "frozen odometer".
std::string FaultName(VehicleFault fault);

/// Whether it is one of reports and not of logs.
bool IsOfReports(VehicleFault fault);

/// The log as a vehicle with the fault records it; as it is if the fault is one of reports.
Run WithFault(Run log, VehicleFault fault);

/// The reports that come instead of an honest one; just that one if the fault is one of logs.
/// Precondition: `report` is one of a localizer.
std::vector<ShiftReport> WithFault(const ShiftReport& report, VehicleFault fault);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "localizer/live/fleet_messages.h"
#include "mapstore/cli/context.h"

namespace shiftmap {

/// The fields of a VDA 5050 3.0 state message that the localizer knows: `maps`,
/// `mobileRobotPosition`, `errors` and `instantActionStates`.
Json Vda5050Json(const live::FleetState& state);

/// The same to read.
std::string Vda5050Text(const live::FleetState& state);

}  // namespace shiftmap

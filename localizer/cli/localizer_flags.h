// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "localizer/localizer_options.h"
#include "mapstore/cli/command.h"

namespace shiftmap {

/// Adds `--max-range-m`, `--max-speed-mps` and `--max-yaw-rate-radps`.
void AddLimitOptions(Command* command, LimitOptions* limits);

/// What is wrong with `--vehicle`, for a report; empty if nothing is.
std::string CheckVehicleName(const std::string& vehicle);

}  // namespace shiftmap

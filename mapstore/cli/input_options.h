// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/command.h"
#include "mapstore/run/item_limits.h"

namespace shiftmap {

/// Adds `--max-range-m`, `--max-speed-mps` and `--max-yaw-rate-radps`; `limits` must outlive the
/// run.
void AddLimitOptions(LimitOptions* limits, Command* command);

/// Adds `--clock-tolerance-s` to a command that takes what has a time; `value` must outlive the
/// run.
void AddClockToleranceOption(double* value, Command* command);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds the command `check`.
void AddCheckCommand(Application* application);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds the commands of shiftmap-sim.
void AddSimCommands(Application* application);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/cli/context.h"
#include "tools/sim/simulated_world.h"

namespace shiftmap {

/// Reports what was simulated: groups, and per run its path and counts.
/// @param paths  Of the run logs; empty if nothing was written.
void ReportWorld(const SimulatedWorld& world,
                 const std::string& directory,
                 const std::vector<std::string>& paths,
                 Context* context);

}  // namespace shiftmap

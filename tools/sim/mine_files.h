// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "proto/core/status.h"
#include "tools/sim/mine_world.h"

namespace shiftmap {

/// Writes a plan into a folder that exists: plan.csv (version,x1_m,y1_m,x2_m,y2_m), its walls by
/// version; plan.svg, both versions, barriers dashed, every place of every landmark, and the path.
/// Errors: as WriteFileAtomically.
Status WriteMinePlan(const MineSite& site, const std::string& directory);

}  // namespace shiftmap

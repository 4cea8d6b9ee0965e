// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tools/experiment/tiv_mine.h"

namespace shiftmap {

/// T-IV figure 8 as SVG: walls of both versions, the trajectories of a drive, and its map at the
/// end: modes with their 95 % ellipses, dashed where another one, or none, is likelier.
std::string DrawTivPosterior(const TivWorld& world, const TivMineRun& run);

}  // namespace shiftmap

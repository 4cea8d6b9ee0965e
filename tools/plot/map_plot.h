// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// A map as an SVG picture, equal axes, y up: every mode with its 95 % ellipse and probability
/// (LandmarkLayer), and the trajectories of runs.
/// @param runs     That the version was built from, each with a colour.
/// @param earlier  Of its ancestors, in grey.
std::string PlotMap(const MapSnapshot& map,
                    const std::vector<RunRecord>& runs,
                    const std::vector<RunRecord>& earlier);

}  // namespace shiftmap

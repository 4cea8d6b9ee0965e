// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/map_store.h"

namespace shiftmap {

/// A map as an SVG picture, equal axes, north up: every mode with its 95 % ellipse, the most
/// probable one of each landmark filled, the others joined to it (a landmark that is most probably
/// absent has none filled, and says so); trajectories of the runs that
/// built the map; metres along the edges. Colours can be told apart with any colour vision.
std::string PlotMap(const MapSnapshot& snapshot, const Provenance& provenance);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/map/map_snapshot.h"
#include "tools/inspect/move_rate_estimate.h"

namespace shiftmap {

/// The move rates (MoveRate) of a map's landmarks with their intervals as an SVG picture, sorted,
/// on a logarithmic axis. Of more landmarks than have room for a row with a name each, rows are
/// thin and without names.
std::string PlotRates(const MapSnapshot& map, const MoveRates& rates);

}  // namespace shiftmap

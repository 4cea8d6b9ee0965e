// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/map/landmark_group.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// The modes of one landmark as an SVG picture: where they lie to each other, with arrows by the
/// rates of the chain between them; each mode by itself, with its 95 % ellipse at a scale of its
/// own; and the rates of the chain, `absent` included.
/// @param group  A group of the map.
std::string PlotModes(const MapSnapshot& map, const LandmarkGroup& group);

}  // namespace shiftmap

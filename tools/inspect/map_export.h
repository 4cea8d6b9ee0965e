// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "mapstore/cli/context.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// The document of `shiftmap-inspect show --json`. Mode 0, `absent`, comes first in each group and
/// has a probability only.
Json MapJson(const MapSnapshot& snapshot, const std::optional<VersionNumber>& parent);

/// A GeoJSON FeatureCollection with a Point per mode and per anonymous landmark. Coordinates are
/// metres in the map frame, not longitude and latitude; the collection says so.
std::string MapGeoJson(const MapSnapshot& snapshot);

/// A line per mode: signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability; what `shiftmap-mapper import`
/// reads.
std::string MapCsv(const MapSnapshot& snapshot);

}  // namespace shiftmap

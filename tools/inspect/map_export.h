// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "mapstore/cli/context.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// The document of `shiftmap-inspect show --json`. Mode 0, `absent`, comes first in each group and
/// has a probability only.
Json MapJson(const MapSnapshot& snapshot, const std::optional<VersionNumber>& parent);

/// The rhythm of a chain, which has one: its period, and for each of its equal parts the mean rate
/// of leaving a state and the rate matrix by rows. UTC; a week begins on Monday.
Json RhythmJson(const ChainRhythm& rhythm);

/// A GeoJSON FeatureCollection with a Point per mode and per anonymous landmark. Coordinates are
/// metres in the map frame, not longitude and latitude; the collection says so. `shiftmap-mapper
/// import` reads it: positions with their marginal covariances, probabilities and leave rates.
std::string MapGeoJson(const MapSnapshot& snapshot);

/// A line per mode: signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability; what `shiftmap-mapper import`
/// reads.
std::string MapCsv(const MapSnapshot& snapshot);

/// A g2o graph: a VERTEX_XY per mode and per anonymous landmark, with an EDGE_PRIOR_XY of its
/// marginal information [1/m²], and a fixed VERTEX_SE2 per pose of the runs. A version keeps no
/// measurement, so there are no edges between poses, and none from poses to landmarks; correlations
/// between landmarks are left out. Comments say which vertex is which.
std::string MapG2o(const MapSnapshot& snapshot, const Provenance& provenance);

}  // namespace shiftmap

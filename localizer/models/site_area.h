// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// The area that landmarks may stand on: the box around all modes, and no less than what a sensor
/// sees at once. [m²]
double SiteArea(const MapSnapshot& snapshot);

/// Density at which a landmark that is at none of its modes is seen, per m² of the vehicle frame
/// and scan: it is on the site with probability 1/2, anywhere, and detected as others are. No less
/// than the sensor's, which is that of landmarks that no map has. [1/m²]
double UnknownPlaceDensity(const MapSnapshot& snapshot);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// How often a landmark leaves the mode it is at.
struct LeaveRate {
  Signature signature;
  double map_per_s = 0.0;   ///< Of the map's chain. [1/s]
  double rate_per_s = 0.0;  ///< By the visits, with the prior of the map's landmarks. [1/s]
  double low_per_s = 0.0;   ///< 95 % interval. [1/s]
  double high_per_s = 0.0;
  std::int64_t visits = 0;  ///< That tell of it.
};

/// The rates as an SVG picture, sorted, on a logarithmic axis. Of more landmarks than have room for
/// a row with a name each, rows are thin and without names.
std::string PlotRates(const MapSnapshot& map, std::vector<LeaveRate> rates);

}  // namespace shiftmap

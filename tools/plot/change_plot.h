// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// Two versions of a map in one SVG picture: landmarks that stand at another mode now, that came
/// and went, modes that are new, gone or merged, estimates that moved by more than chance does, and
/// other changes of probability; what did not change is grey.
std::string PlotDiff(const MapSnapshot& from, const MapSnapshot& to);

/// What a night did to a map.
struct Night {
  std::optional<MapSnapshot> parent;  ///< The version before; nothing: the map is the first one.
  std::vector<RunRecord> mapped;      ///< Runs that the version was built from.
  std::vector<UnplacedRun> waiting;   ///< Runs that wait for another build.
  std::vector<Exclusion> exclusions;  ///< Runs and vehicles that are excluded or held.
};

/// The same of a version against its parent, with the runs that were mapped, and lists of these and
/// of what waits and is held.
std::string PlotNight(const MapSnapshot& map, const Night& night);

}  // namespace shiftmap

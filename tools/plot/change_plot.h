// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/geometry/se2.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// A map as CarryMap leaves it: with the names, and in the frame, of the one it is compared with.
struct EarlierMap {
  MapSnapshot map;
  std::vector<std::pair<Signature, Signature>> renamed = {};  ///< Name before and after.
  std::optional<Se2> moved = std::nullopt;  ///< T_to_from that was applied; nothing: none was.
};

/// How a frame moved: "turned by 2.31° about the origin and moved by (1.20, -0.40) m".
std::string FrameText(const Se2& T_to_from);

/// Two versions of a map in one SVG picture: landmarks that stand at another mode now, that came
/// and went, modes that are new, gone or merged, estimates that moved by more than chance does, and
/// other changes of probability; what did not change is grey. The legend names what is taken out:
/// renames, and a motion of the frame.
std::string PlotDiff(const EarlierMap& from, const MapSnapshot& to);

/// What a night did to a map.
struct Night {
  std::optional<EarlierMap> parent;   ///< The version before; nothing: the map is the first one.
  std::vector<RunRecord> mapped;      ///< Runs that the version was built from.
  std::vector<UnplacedRun> waiting;   ///< Runs that wait for another build.
  std::vector<Exclusion> exclusions;  ///< Runs and vehicles that are excluded or held.
};

/// The same of a version against its parent, with the runs that were mapped, and lists of these and
/// of what waits and is held.
std::string PlotNight(const MapSnapshot& map, const Night& night);

}  // namespace shiftmap

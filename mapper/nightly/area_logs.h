// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapper/nightly/fleet_folder.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The logs of an area, by what a build has to do with them.
struct AreaLogs {
  std::vector<LogHead> fresh;     ///< No build has seen them.
  std::vector<LogHead> waiting;   ///< An earlier build could not place them.
  std::vector<LogHead> again;     ///< In the map, but not in what a build goes on from.
  std::vector<LogHead> mapped;    ///< In what a build goes on from.
  std::vector<LogHead> excluded;  ///< Somebody took them out.
  std::vector<std::string> held;  ///< Lines about runs that somebody has to decide about.
};

/// Tells an area's logs apart by the identity of their runs, and names runs that wait for a build
/// and of which no log is there.
/// @param store  Null: there is none, and all are fresh.
/// Errors: those of the store; as HashFile.
StatusOr<AreaLogs> SortLogs(const std::string& area, std::vector<LogHead> logs, MapStore* store);

}  // namespace shiftmap

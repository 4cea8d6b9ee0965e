// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mapper/mapper.h"
#include "mapstore/cli/context.h"
#include "mapstore/map_store.h"
#include "mapstore/run/item_limits.h"

namespace shiftmap {

/// The calibration of each vehicle, `[low, high]` beside each value.
Json VehiclesJson(const std::vector<VehicleEstimate>& vehicles);

/// Why a run waits, in words: which landmarks may have stayed, and which of them would decide.
std::string WaitingReason(const AmbiguousChange& change);

/// The same of one that waits since an earlier build and was not given to this one.
std::string WaitingReason(const UnplacedRun& run);

/// One line for each run of a build that waits, that is in the map while it is ambiguous which of
/// its landmarks stayed, and that is left out, with the reason.
std::vector<std::string> WaitingLines(const MapperResult& result);
std::vector<std::string> KeptLines(const MapperResult& result);
std::vector<std::string> LeftOutLines(const MapperResult& result);

/// What `shiftmap-mapper build --json` says of a build.
/// @param dropped    By the log's SHA-256.
/// @param not_given  Runs that wait, but not of this build.
/// @param commit     Nothing if no version was made.
Json BuildJson(const std::string& area,
               const MapperResult& result,
               const std::map<std::string, ImplausibleItems>& dropped,
               const std::vector<UnplacedRun>& not_given,
               const std::optional<CommitResult>& commit);

/// The same for people.
std::string BuildText(const MapperResult& result, const std::optional<CommitResult>& commit);

}  // namespace shiftmap

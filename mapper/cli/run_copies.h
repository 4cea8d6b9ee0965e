// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/run/run.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Whether one of two logs is a copy of the other that was cut off: they have one UUID or, where
/// one has none, one vehicle and odometry, as far as the shorter goes.
/// Precondition: both have odometry.
bool AreCopies(const Run& a, const Run& b);

/// The run of a map that a log is of: by its hash or UUID, or where one of the two has no UUID, one
/// of its vehicle with its begin whose visits it saw. Null if there is none.
/// @param saw_visits  Whether the log saw the visits of that run (SawVisits). It takes the whole
///                    log and the ledger, and is called for such a run only.
StatusOr<const LineRun*> FindMappedRun(
    const std::vector<LineRun>& runs,
    const RunInfo& info,
    const std::string& sha256,
    Stamp begin,
    const std::function<StatusOr<bool>(const LineRun& run)>& saw_visits);

/// Whether a run saw most of what a map's ledger has of the visits of another one until it ends, at
/// the same times: one is a copy of the other then.
/// @param rows  Of any runs; those of `source` count.
bool SawVisits(const Run& run, const std::string& source, const std::vector<EvidenceRow>& rows);

/// What the map lacks of a run whose copy of a log it was built from ends before this one, and how
/// to get it; nothing if it lacks nothing.
/// @param end  Of the log.
std::optional<std::string> MissingRest(const LineRun& mapped, Stamp end);

}  // namespace shiftmap

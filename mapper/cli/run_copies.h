// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map_store.h"
#include "mapstore/run/run.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Whether two logs are of one run: they have one UUID or, where one has none, one vehicle and
/// odometry, as far as the shorter goes.
/// Precondition: both have odometry.
bool AreOfOneRun(const Run& a, const Run& b);

std::int64_t CountObservations(const Run& run);

/// Whether a log of a run tells less of it than another one: by observations, then scans, end and
/// odometry. Precondition: as AreOfOneRun.
bool HasFewer(const Run& a, const Run& b);

/// Whether a log has all scans of another one, which may have been cut off.
bool HasScansOf(const Run& whole, const Run& part);

/// The run of a map that a log is of: by its hash or UUID, or where one of the two has no UUID, one
/// of its vehicle with its begin that it is a log of. Null if there is none.
/// @param is_log_of  As IsLogOf. It takes the whole log and the ledger, and is called for such a
///                   run only.
StatusOr<const LineRun*> FindMappedRun(
    const std::vector<LineRun>& runs,
    const RunInfo& info,
    const std::string& sha256,
    Stamp begin,
    const std::function<StatusOr<bool>(const LineRun& run)>& is_log_of);

/// Whether a log of a mapped run's vehicle and begin is of that run: it has its end too, by a clock
/// that was set, or saw most of what a map's ledger has of its visits until the log's last
/// sighting, at the same times.
/// @param rows  Of any runs; those of `mapped` count.
bool IsLogOf(const Run& run, const RunRecord& mapped, const std::vector<EvidenceRow>& rows);

/// What the map lacks of a log of a run that it was built from another log of, and how to get it;
/// nothing if it lacks nothing: the other one is of its vehicle and time, does not end before this
/// one, nor has fewer observations, where the version states those of its logs.
/// Errors: those of the store.
StatusOr<std::optional<std::string>> MissingRest(const std::string& area,
                                                 const LineRun& mapped,
                                                 const Run& log,
                                                 MapStore* store);

}  // namespace shiftmap

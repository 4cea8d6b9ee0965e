// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "mapstore/sqlite/database.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The exclusions of an area that hold: excluded ones, then held ones, of each those of runs first.
/// @param known  Those that held at this time instead.
StatusOr<std::vector<Exclusion>> ReadExclusions(Database& database,
                                                std::int64_t area_id,
                                                std::optional<Stamp> known = std::nullopt);

/// Adds one to those that hold. An exclusion takes the place of a hold, and one of a vehicle that
/// of a later one, since the earlier of the two times. Returns the one that holds now, which is
/// `holding`'s, or null if one is there.
const Exclusion* AddExclusion(Exclusion exclusion, std::vector<Exclusion>* holding);

/// Writes what AddExclusion() returned, in place of one of the same run or vehicle.
Status WriteExclusion(Database& database, std::int64_t area_id, const Exclusion& exclusion);

/// Both. Returns false if one is there.
StatusOr<bool> InsertExclusion(Database& database, std::int64_t area_id, Exclusion exclusion);

/// Takes one back. Returns false if none holds.
StatusOr<bool> EndExclusion(Database& database,
                            std::int64_t area_id,
                            const Exclusion& exclusion,
                            Stamp ended);

/// An exclusion of a report by its UUID that was made before the report came is one of the report's
/// run from then on. Returns it if there is one, and none of the run yet.
StatusOr<std::optional<Exclusion>> ExcludeRunOfReport(Database& database,
                                                      std::int64_t area_id,
                                                      const std::string& uuid,
                                                      const std::string& run,
                                                      Stamp received);

/// Whether one of a run was taken back.
StatusOr<bool> WasIncluded(Database& database, std::int64_t area_id, const std::string& run);

/// The run of an area that is meant: a SHA-256 as it is, known or not; the log of a report if it
/// has one, else the report's UUID; or the only one that the area knows by these first digits, or
/// of which a log of that name was mapped. Errors: kInvalidArgument if it may be several; kNotFound
/// if it is none.
StatusOr<std::string> FindRun(Database& database, std::int64_t area_id, const std::string& text);

/// The vehicle whose exclusion or hold is about a run; nothing if the run is not known, or none is.
StatusOr<std::optional<std::string>> ExcludedVehicleOf(Database& database,
                                                       std::int64_t area_id,
                                                       const std::string& identity,
                                                       const std::vector<Exclusion>& holding);

/// The identity of a run, the SHA-256 of each log of it that the store knows, and the UUID of each
/// report about it.
StatusOr<std::set<std::string>> NamesOfRun(Database& database,
                                           std::int64_t area_id,
                                           const std::string& identity);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <set>

#include "mapstore/map/edited_map.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A version with other edits than it holds: the build or import that it rests on, without what is
/// not wanted and with what is, in the order the edits were made. Whatever edits were made and
/// taken back since then leaves no trace, but for the numbers of modes.
/// @param wanted   Edits that are to hold. One that runs were mapped with and that cannot be taken
///                 out of them holds all the same.
/// @param lenient  Edits that cannot be made any more are left out; otherwise they are an error.
/// Errors: kNotFound and kInvalidArgument as EditedMap::Apply; kFailedPrecondition if content that
/// it takes was compacted away.
StatusOr<EditedMap> RecomputeContent(Database& database,
                                     std::int64_t area_id,
                                     const VersionRow& version,
                                     const std::set<EditId>& wanted,
                                     bool lenient);

/// The edits that a version holds and that are in force, and of those that were taken back the ones
/// that stay in it: what they took away was compacted away.
StatusOr<std::set<EditId>> EditsThatStay(Database& database,
                                         std::int64_t area_id,
                                         const VersionRow& version);

/// Whether an edit that a version holds can be taken out of it.
StatusOr<bool> CanRemove(Database& database,
                         std::int64_t area_id,
                         const VersionRow& version,
                         const MapEdit& edit);

/// What an edit of calibration leaves of the vehicle.
StatusOr<std::optional<VehicleCalibration>> ReadKept(Database& database,
                                                     std::int64_t area_id,
                                                     const MapEdit& edit);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/map/evidence.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Checks what the ledger relies on in a report that is to be added: a UUID, times in order, finite
/// log-likelihoods with `absent` first, no two visits of a group at the same time.
/// Errors: kInvalidArgument, naming the report.
Status CheckReport(const ShiftReport& report);

/// True if a report with this UUID is in the ledger, whatever the case of its letters.
StatusOr<bool> HasReport(Database& database, const std::string& uuid);

/// Adds a checked report that is not there yet.
Status InsertReport(Database& database,
                    std::int64_t area_id,
                    std::int64_t version_id,
                    const ShiftReport& report);

/// How many evidence rows of `report` name a group or a mode that the version does not have.
/// @param version_id  Nothing: no version has any.
StatusOr<int> CountUnknownModes(Database& database,
                                std::optional<std::int64_t> version_id,
                                const ShiftReport& report);

/// Hands out the ledger rows that count for a version, a landmark at a time, by signature: those
/// of reports made against the version itself, and those of reports made against an ancestor whose
/// visit began after the version's stamp (what happened before is in the version already).
/// @param lineage  The version first, then its ancestors.
/// @param at       Rows that begin later do not count.
/// Errors: kDataLoss if a row is damaged.
Status ForEachLandmark(
    Database& database,
    std::int64_t area_id,
    const std::vector<VersionRow>& lineage,
    std::optional<Stamp> at,
    const std::function<void(const Signature&, std::vector<EvidenceRow>)>& consume);

/// Unmapped sightings of an area, newest first.
StatusOr<std::vector<UnmappedSighting>> ReadSightings(Database& database, std::int64_t area_id);

}  // namespace shiftmap

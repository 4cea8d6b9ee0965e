// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "mapstore/sqlite/database.h"
#include "mapstore/store/report_rows.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

// A reader filters the rows after the newest checkpoint, so their number bounds what it costs. The
// newest checkpoint stays some rows behind the end of the ledger: vehicles of one shift report
// about the same hours one after the other, and each would invalidate what lies at its end. For
// large maps the rows between checkpoints are more, so that checkpoints stay small against the
// ledger.

/// Deletes the checkpoints that a report made wrong, and adds the next one of the published version
/// once enough rows have come. Inside the transaction that added the report.
/// @param published        Nothing if none is.
/// @param checkpoint_rows  Rows between checkpoints of a small map.
/// @param owner            Starts messages about the published version.
Status KeepCheckpoints(Database& database,
                       std::int64_t area_id,
                       const InsertedReport& inserted,
                       std::int64_t rows_added,
                       const std::optional<VersionRow>& published,
                       std::int64_t checkpoint_rows,
                       const std::string& owner);

/// Adds the checkpoints of a version up to some rows before the end of the ledger. Outside of any
/// transaction: between steps of some tenths of a second others read and write, however long the
/// ledger is. Where others write all the time it leaves off; without a checkpoint a reader takes
/// longer.
Status ExtendCheckpoints(Database& database,
                         std::int64_t area_id,
                         std::int64_t version_id,
                         std::int64_t checkpoint_rows,
                         const std::string& owner);

}  // namespace shiftmap

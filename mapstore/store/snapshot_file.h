// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Whether a store is a snapshot: it has no audit log.
StatusOr<bool> IsSnapshot(Database& database);

/// Writes one version of an area into a new store at `path`: its content, provenance without
/// trajectories, its newest ledger checkpoint and the rows after it that count, and of the versions
/// that these were reported against the version rows. Published there, compact, not yet durable.
/// @param source  Inside a read transaction.
/// @param latest  The checkpoint holds no visit that begins later.
/// @param wait    For a writer that lets no second reader in. Errors: kAborted if it does not go on
///                meanwhile; it may wait for the transaction of `source`.
Status WriteSnapshotFile(Database& source,
                         std::int64_t area_id,
                         const VersionRow& version,
                         const MapContent& content,
                         Stamp latest,
                         std::chrono::milliseconds wait,
                         const std::string& path);

}  // namespace shiftmap

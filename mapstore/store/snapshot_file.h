// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Makes a store of its own that holds one version of an area as the published one: its content,
/// its provenance without trajectories, and the ledger rows that count for it, so that LoadAt gives
/// the same there as here. Of its ancestors only the version rows go along, since the reports refer
/// to them.
/// @param source   The store; `area_id` and `lineage`, the version first, are of it.
/// @param path     A file that does not exist. It is not synced.
Status WriteSnapshotFile(Database& source,
                         std::int64_t area_id,
                         const std::vector<VersionRow>& lineage,
                         const std::string& path);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "mapstore/map_store.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Names the runs that a version was built from, and adds their evidence to the ledger. A run that
/// an earlier version used is kept once.
Status InsertRuns(Database& database,
                  std::int64_t area_id,
                  std::int64_t version_id,
                  const std::vector<RunRecord>& runs);

/// Adds what a version says of runs of its ancestors to the ledger.
Status InsertOlderEvidence(Database& database,
                           std::int64_t area_id,
                           std::int64_t version_id,
                           const std::vector<RunRecord>& runs);

/// Tool, configuration, seed and runs of a version. `owner` starts the messages.
StatusOr<Provenance> ReadProvenance(Database& database,
                                    std::int64_t version_id,
                                    const std::string& owner);

/// All runs that a version and its ancestors were built from, by begin and name.
StatusOr<std::vector<LineRun>> ReadLineRuns(Database& database, std::int64_t version_id);

/// Their RunRecord::sha256 and RunRecord::identity.
StatusOr<std::set<std::string>> ReadRunIdentities(Database& database, std::int64_t version_id);

}  // namespace shiftmap

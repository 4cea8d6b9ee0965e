// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/sqlite/database.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Of a run that waits; its subject is the log's hash, a blank and the run's name.
inline constexpr const char* kWaitAction = "wait";

/// Adds an entry to the audit log, inside the transaction of what it is about.
/// @param area_id  Nothing: it is about the whole store.
Status InsertAudit(Database& database,
                   std::optional<std::int64_t> area_id,
                   const char* action,
                   const std::string& subject);

/// All entries, oldest first. @param area_id  Of one area only.
StatusOr<std::vector<AuditEntry>> ReadAudit(Database& database,
                                            std::optional<std::int64_t> area_id);

}  // namespace shiftmap

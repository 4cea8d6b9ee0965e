// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/clock.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Adds an entry to the audit log, inside the transaction of what it is about.
/// @param area_id  Nothing: it is about the whole store.
/// @param written  By the clock of this machine.
Status InsertAudit(Database& database,
                   std::optional<std::int64_t> area_id,
                   AuditAction action,
                   const std::string& subject,
                   Stamp written = SystemNow());

/// The version that was published last by a time; nothing if none was.
StatusOr<std::optional<VersionNumber>> PublishedBy(Database& database,
                                                   std::int64_t area_id,
                                                   Stamp at);

/// All entries, oldest first.
/// @param area_id  Of one area only.
/// @param only     Of these actions; empty: of all.
StatusOr<std::vector<AuditEntry>> ReadAudit(Database& database,
                                            std::optional<std::int64_t> area_id,
                                            const std::vector<AuditAction>& only = {});

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "mapstore/map/visibility.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// mapped_visibility.scans; nothing if the bytes are no such BLOB.
std::optional<Visibility> UnpackScans(std::string_view bytes);

/// Adds how well a version's run saw its modes.
Status InsertVisibility(Database& database,
                        std::int64_t version_id,
                        std::int64_t run_id,
                        const std::vector<ModeVisibility>& visibility);

/// MapStore::MappedVisibility. Lifetime: the database's, inside one transaction.
StatusOr<std::vector<ModeVisibility>> ReadLineVisibility(Database& database,
                                                         std::int64_t area_id,
                                                         const VersionRow& version,
                                                         const std::set<std::string>& without_runs);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "mapstore/map/mode_filter.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// MapStore::Evidence. Lifetime: the database's, inside one transaction.
StatusOr<std::vector<EvidenceRow>> ReadLineEvidence(Database& database,
                                                    std::int64_t area_id,
                                                    const VersionRow& version,
                                                    const std::set<std::string>& without_runs);

}  // namespace shiftmap

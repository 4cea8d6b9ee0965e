// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Checks the evidence of a version's runs: `absent` first and modes of the content, in order;
/// finite, at most kMaxVisitLogRatio apart; visits in the order of time and within their run.
/// Errors: kInvalidArgument, naming the first run and landmark that is wrong.
Status CheckRunEvidence(const std::vector<RunRecord>& runs, const MapContent& content);

/// Adds the evidence of a version's run to the ledger.
Status InsertMappedEvidence(Database& database,
                            std::int64_t area_id,
                            std::int64_t version_id,
                            std::int64_t run_id,
                            const std::vector<VisitEvidence>& evidence);

}  // namespace shiftmap

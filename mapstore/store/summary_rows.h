// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "mapstore/map/mode_filter.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/ledger_cursor.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What a row of the ledger that stands for several visits keeps of them.
struct LedgerSummary {
  std::int64_t visits = 1;
  std::int64_t steps = 0;  ///< As many equal gaps tell of rates what the visits' own gaps tell.
  double gap_s = 0.0;      ///< Sum of the times between the visits. [s]
};

/// What tells rows of an area apart, as ledger_summary has them: begin and end in ns, report,
/// version, run, landmark.
using SummaryKey =
    std::tuple<std::int64_t, std::int64_t, std::int64_t, std::int64_t, std::int64_t, std::string>;

SummaryKey SummaryKeyOf(const LedgerKey& row);

/// The summaries of an area.
StatusOr<std::map<SummaryKey, LedgerSummary>> ReadSummaries(Database& database,
                                                            std::int64_t area_id);

/// Adds a row that stands for several.
/// @param log_likelihoods  As in blob.h.
Status InsertSummary(Database& database,
                     std::int64_t area_id,
                     const LedgerKey& row,
                     std::int64_t observations,
                     const std::string& log_likelihoods,
                     const LedgerSummary& summary);

/// Deletes the summaries of rows that are gone.
Status DeleteOrphanedSummaries(Database& database, std::int64_t area_id);

/// Visits that say what a row and its summary say: one at either end and one after each step, all
/// alike. A chain stands still inside a visit, so that one long visit would not do.
std::vector<EvidenceRow> ExpandSummary(const EvidenceRow& row, const LedgerSummary& summary);

}  // namespace shiftmap

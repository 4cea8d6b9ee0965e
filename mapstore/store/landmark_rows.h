// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "mapstore/landmark_records.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/ledger_view.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A visit with what its ledger row refers to, as LedgerRow has it.
struct LandmarkVisitRow {
  LandmarkVisit visit;
  std::int64_t report_id = 0;
  std::int64_t run_id = 0;
  std::int64_t version_id = 0;
};

/// All rows of the ledger about a landmark of the view's version, under whatever name, in the order
/// of LandmarkRecords::visits, with the decisions; nothing is judged, and there are no
/// probabilities.
///
/// Cost: one pass over the ledger of the area, which is in the order of time.
StatusOr<std::vector<LandmarkVisitRow>> ReadLandmarkVisits(Database& database,
                                                           std::int64_t area_id,
                                                           const Signature& signature,
                                                           LedgerView* view);

/// The newest rows of the ledger about all landmarks, at most so many; else as
/// ReadLandmarkVisits.
StatusOr<std::vector<LandmarkVisitRow>> ReadNewestVisits(Database& database,
                                                         std::int64_t area_id,
                                                         std::int64_t max_visits);

/// A landmark of the view's version in every version of an area whose content is stored, oldest
/// first.
/// @param version  Whose line LandmarkInVersion::in_line is about.
StatusOr<std::vector<LandmarkInVersion>> ReadLandmarkVersions(Database& database,
                                                              std::int64_t area_id,
                                                              const VersionRow& version,
                                                              const Signature& signature,
                                                              LedgerView* view);

}  // namespace shiftmap

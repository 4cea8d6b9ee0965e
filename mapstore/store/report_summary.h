// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "mapstore/map/evidence.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/mode_numbers.h"
#include "mapstore/store/report_rows.h"
#include "mapstore/store/version_rows.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// How many rows of a report that was just added do not count for the published version, by reason.
/// @param numbers  Of the published version.
StatusOr<std::vector<SetAsideRows>> CountSetAside(Database& database,
                                                  const VersionRow& published,
                                                  const VersionRow& reported,
                                                  const InsertedReport& inserted,
                                                  const ShiftReport& report,
                                                  ModeNumbers* numbers);

/// All reports of an area, newest first, and what they mean for a version.
/// @param content  The version's; only its groups are looked at.
StatusOr<std::vector<ReportSummary>> SummarizeReports(Database& database,
                                                      std::int64_t area_id,
                                                      const VersionRow& version,
                                                      const MapContent& content);

}  // namespace shiftmap

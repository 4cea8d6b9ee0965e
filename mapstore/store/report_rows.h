// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/map/evidence.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A report is about a run that has its identity or log. A report about a log, by a clock that was
/// set, is also about a run of its vehicle that begins at the same time, if one of the two logs has
/// no UUID: one is a copy of the other that was cut off. Of two reports each has a visit before the
/// other ends, too.

/// `FROM ... WHERE r.report_id = report`: the reports `o`, against the versions `ov`, about the run
/// of a report `r`, against the version `v`.
std::string SameRunSql(std::string_view report = "?1");

/// Whether `o` comes before `r`, whichever came first: it is longer, as begin is the same, or else
/// against a lower version, or of a lower UUID.
inline constexpr char kComesBeforeSql[] =
    "(o.end_ns > r.end_ns OR (o.end_ns = r.end_ns AND (ov.number, o.uuid) < (v.number, r.uuid)))";

/// True if a report with this UUID is in the ledger, whatever the case of its letters.
StatusOr<bool> HasReport(Database& database, const std::string& uuid);

/// A report as it was added.
struct InsertedReport {
  std::int64_t report_id = 0;
  std::string run;  ///< ReportSummary::run.
  Stamp received;

  /// Begin of the first visit that it may make count, or no longer count, for some version: its
  /// own, or one of the reports about its run that it comes before. Nothing without evidence.
  std::optional<Stamp> changed_from;
};

/// Adds a checked report that is not there yet, made against `version` of the area.
/// @param received  When it came, by the clock of this machine.
StatusOr<InsertedReport> InsertReport(Database& database,
                                      std::int64_t area_id,
                                      const VersionRow& version,
                                      const ShiftReport& report,
                                      Stamp received);

/// Whether the run that a report names was mapped, or another report names it.
StatusOr<bool> IsKnownOtherwise(Database& database, std::int64_t report_id);

/// Notes which reports are about a run that a version was built from.
Status InsertMappedReports(Database& database, std::int64_t version_id);

/// The reports in the ledger so far.
StatusOr<LedgerPosition> ReadLedgerPosition(Database& database);

/// Unmapped sightings of an area, newest first.
StatusOr<std::vector<UnmappedSighting>> ReadSightings(Database& database, std::int64_t area_id);

}  // namespace shiftmap

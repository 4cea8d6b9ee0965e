// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "mapstore/map/edited_map.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map_store.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/sqlite/transaction.h"
#include "mapstore/store/ledger_filter.h"
#include "mapstore/store/mode_numbers.h"
#include "mapstore/store/report_rows.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What the parts of MapStore share.
struct MapStore::State {
  Database database;
  std::int64_t checkpoint_rows = 0;
  std::function<Stamp()> clock;
  double clock_tolerance_s = 0.0;
  std::optional<ModeNumbers> numbers = std::nullopt;  // Of the version asked for last.

  /// The latest time that is not taken for a wrong clock's.
  Stamp LatestStamp(std::optional<Stamp> known = std::nullopt) const {
    return known.value_or(clock()) + FromSeconds(clock_tolerance_s);
  }

  std::string AreaName(const std::string& area) const;
  std::string VersionName(const std::string& area, VersionNumber version) const;

  StatusOr<Transaction> Read() { return Transaction::Begin(database, Transaction::Kind::kRead); }
  StatusOr<Transaction> Write() { return Transaction::Begin(database, Transaction::Kind::kWrite); }

  /// Write(), or in a dry run Read() of what could be written.
  StatusOr<Transaction> Change(bool dry_run);

  /// Errors: kNotFound if nothing is published.
  StatusOr<VersionRow> PublishedRow(const std::string& area, const AreaRow& area_row);

  /// The version by number, inside a transaction. Errors: kNotFound if there is none.
  StatusOr<VersionRow> RowOf(const std::string& area, VersionNumber version);

  /// The version by number, or the published one.
  /// @param known  At this time; nothing: now.
  StatusOr<VersionRow> SelectRow(const std::string& area,
                                 const AreaRow& area_row,
                                 std::optional<VersionNumber> version,
                                 std::optional<Stamp> known = std::nullopt);

  /// The version that was published at a time. Errors: kNotFound if none was.
  StatusOr<VersionRow> PublishedRowAt(const std::string& area, const AreaRow& area_row, Stamp at);

  /// A version as its ledger is filtered for a query.
  struct Filtered {
    VersionRow row;
    MapContent content;  ///< With the probabilities that the ledger implies, at their time.
    VehicleRecords records;
  };

  /// Inside a transaction.
  StatusOr<Filtered> Filter(const std::string& area,
                            std::optional<VersionNumber> version,
                            const LedgerQuery& query);

  /// A version and what a query of the ledger gives for it, inside a transaction.
  StatusOr<MapSnapshot> Load(const std::string& area,
                             std::optional<VersionNumber> version,
                             const LedgerQuery& query);

  /// Former names of a version's landmarks.
  StatusOr<std::map<Signature, Signature>> AliasesOf(const std::string& area,
                                                     const VersionRow& version);

  /// The mode numbers of a version that is committed.
  StatusOr<ModeNumbers*> NumbersOf(const VersionRow& version);

  /// Errors: kFailedPrecondition if the file is a snapshot.
  /// @param what  That a snapshot does not do.
  Status RefuseSnapshot(const char* what);

  /// MapStore::ExportWithIdentity, once. Errors also: kAborted if a writer came in between.
  StatusOr<ExportedSnapshot> Export(const std::string& area, const std::string& path);

  /// MapStore::ExcludeAll and IncludeAll.
  Status ChangeExclusions(const std::string& area,
                          std::vector<Exclusion> exclusions,
                          bool exclude,
                          bool dry_run);

  /// Adds one to those that hold, and returns it as it holds. Errors: as MapStore::Exclude.
  StatusOr<Exclusion> AddOne(const std::string& area,
                             const Exclusion& exclusion,
                             std::vector<Exclusion>* holding) const;

  /// Takes one out of those that hold, by each name of its run, and returns what is taken out.
  /// Errors: as MapStore::IncludeAll.
  StatusOr<std::vector<Exclusion>> EndOne(const std::string& area,
                                          const AreaRow& area_row,
                                          const Exclusion& exclusion,
                                          std::vector<Exclusion>* holding);

  /// What a report is about, as the store has it.
  struct Reportable {
    AreaRow area;
    VersionRow version;
  };

  /// Errors: kInvalidArgument if ValidateShiftReport() refuses it.
  Status CheckReport(const ShiftReport& report) const;

  /// Inside a transaction. Errors: as MapStore::Return.
  StatusOr<Reportable> FindReported(const ShiftReport& report);

  /// Holds the run of a live shift that ended before the newest run in the version that it was
  /// driven on, by more than the clock's tolerance: its clock was behind. Not of a clock that was
  /// not set, and not if somebody took the run in before.
  /// @param inserted  What a hold changes is added to changed_from.
  Status HoldIfBeforeItsMap(const ShiftReport& report,
                            const Reportable& reported,
                            InsertedReport* inserted);

  /// Audits that a run or vehicle was excluded or held, or included again.
  Status AuditExclusion(std::int64_t area_id, const Exclusion& exclusion, bool included = false);

  /// Excludes the run of a report that was excluded before it came.
  Status ExcludeIfExpected(const ShiftReport& report,
                           std::int64_t area_id,
                           InsertedReport* inserted);

  /// Adds the rows of a report that is not there yet, inside a transaction.
  StatusOr<ReturnResult> AddReport(const ShiftReport& report,
                                   const Reportable& reported,
                                   const std::string& by);

  /// Adds the reports whose results are OK, in one transaction. After an error nothing is written,
  /// and the results tell nothing.
  Status AddReports(const std::vector<AttributedReport>& reports,
                    std::vector<StatusOr<ReturnResult>>* results);

  /// Makes the checkpoints of a version that was published just now. Without them a reader takes
  /// longer, nothing else.
  void MakeCheckpoints(const std::string& area, std::int64_t area_id, const VersionRow& version);

  /// Adds the rows of a version, inside a transaction. Returns its row, with number and id.
  StatusOr<VersionRow> AddVersion(std::int64_t area_id,
                                  const MapContent& content,
                                  const Provenance& provenance,
                                  bool states_probabilities,
                                  VersionRow version);

  /// Adds a version that is another one with the edits of `map`, inside a transaction.
  /// @param parent  Its parent.
  StatusOr<VersionRow> AddEdited(std::int64_t area_id,
                                 const VersionRow& parent,
                                 const EditedMap& map,
                                 const std::string& tool);

  /// Moves the published pointer inside a transaction. @param action  For the audit log.
  Status MovePublished(std::int64_t area_id, const VersionRow& version, AuditAction action);
};

/// "version 3", or "no version".
std::string DescribeVersion(const std::optional<VersionNumber>& version);

}  // namespace shiftmap

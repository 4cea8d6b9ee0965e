// SPDX-License-Identifier: Apache-2.0
#include "mapstore/maintenance/compact.h"

#include <filesystem>
#include <initializer_list>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/maintenance/thin_ledger.h"
#include "mapstore/map_store.h"
#include "mapstore/schema/store_file.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/sqlite/transaction.h"
#include "mapstore/store/audit_rows.h"
#include "mapstore/store/checkpoint_rows.h"
#include "mapstore/store/checkpoint_upkeep.h"
#include "mapstore/store/ledger_cursor.h"
#include "mapstore/store/ledger_view.h"
#include "mapstore/store/summary_rows.h"
#include "mapstore/store/version_rows.h"

namespace shiftmap {
namespace {

StatusOr<std::vector<std::int64_t>> ReadIds(Database& database,
                                            std::string_view sql,
                                            auto... binds) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare(sql));
  query.Bind(binds...);
  std::vector<std::int64_t> ids;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return ids;
    ids.push_back(query.Int64(0));
  }
}

Status ExecuteEach(Database& database,
                   std::initializer_list<const char*> statements,
                   std::int64_t version_id) {
  for (const char* sql : statements) {
    SHIFTMAP_ASSIGN_OR_RETURN(Statement statement, database.Prepare(sql));
    statement.Bind(version_id);
    SHIFTMAP_RETURN_IF_ERROR(statement.Execute());
  }
  return OkStatus();
}

// An edit may have values of a version hold instead of others.
constexpr const char* kDeleteCalibrations =
    "DELETE FROM vehicle_calibration WHERE version_id = ?1 AND version_id NOT IN "
    "(SELECT kept_version_id FROM map_edit WHERE kept_version_id IS NOT NULL)";

Status DeleteContent(Database& database, std::int64_t version_id) {
  SHIFTMAP_RETURN_IF_ERROR(
      ExecuteEach(database,
                  {"DELETE FROM mode_rate WHERE version_id = ?1",
                   "DELETE FROM mode_rhythm WHERE version_id = ?1",
                   "DELETE FROM merged_mode WHERE version_id = ?1",
                   "DELETE FROM mode WHERE version_id = ?1",
                   "DELETE FROM landmark_group WHERE version_id = ?1",
                   "DELETE FROM mode_covariance WHERE version_id = ?1",
                   "DELETE FROM anonymous_landmark WHERE version_id = ?1",
                   kDeleteCalibrations,
                   "DELETE FROM ledger_checkpoint WHERE version_id = ?1",
                   "UPDATE version_run SET trajectory = x'' WHERE version_id = ?1",
                   "UPDATE version SET content_stored = 0 WHERE version_id = ?1"},
                  version_id));
  const std::string of_version = fmt::format("version_id = {}", version_id);
  SHIFTMAP_RETURN_IF_ERROR(SetChecksums(database, "version_run", of_version));
  return SetChecksums(database, "version", of_version);
}

// What a version says of the runs that it maps.
Status DeleteMapped(Database& database, std::int64_t version_id) {
  return ExecuteEach(database,
                     {"DELETE FROM mapped_evidence WHERE version_id = ?1",
                      "DELETE FROM mapped_visibility WHERE version_id = ?1",
                      "DELETE FROM ledger_summary WHERE version_id = ?1 AND report_id = 0"},
                     version_id);
}

// Rows of visits that ended before `before` and that count for none of the versions.
StatusOr<std::vector<LedgerKey>> FindSpentEvidence(Database& database,
                                                   std::int64_t area_id,
                                                   const std::vector<std::int64_t>& versions,
                                                   Stamp before) {
  std::vector<LedgerView> views;
  for (const std::int64_t version_id : versions) {
    SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version, GetVersionById(database, version_id));
    views.emplace_back(database, version);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT begin_ns, end_ns, report_id, signature, version_id "
                       "FROM visit_evidence WHERE area_id = ?1 AND begin_ns < ?2 AND end_ns < ?2"));
  rows.Bind(area_id, ToNanoseconds(before));
  std::vector<LedgerKey> spent;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return spent;
    bool counts = false;
    for (LedgerView& view : views) {
      SHIFTMAP_ASSIGN_OR_RETURN(
          const std::optional<SetAside> aside,
          view.JudgeReported(rows.Int64(2), rows.Int64(4), StampFromNanoseconds(rows.Int64(0))));
      // An exclusion of a copy of the log may make it count.
      counts = counts || !aside || aside == SetAside::kExcluded || aside == SetAside::kHeld ||
               aside == SetAside::kSameRun;
      if (counts) break;
    }
    if (counts) continue;
    spent.push_back({StampFromNanoseconds(rows.Int64(0)),
                     StampFromNanoseconds(rows.Int64(1)),
                     rows.Int64(2),
                     0,
                     rows.Int64(4),
                     rows.Text(3)});
  }
}

// Deletes mapped rows of visits that ended before `before` and that count for none of the versions.
// Returns how many.
StatusOr<std::int64_t> DeleteSpentMapped(Database& database,
                                         std::int64_t area_id,
                                         const std::vector<std::int64_t>& versions,
                                         Stamp before) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::vector<std::int64_t> mapping,
      ReadIds(database,
              "SELECT version_id FROM mapped_evidence WHERE area_id = ?1 UNION "
              "SELECT version_id FROM mapped_visibility JOIN version USING (version_id) "
              "WHERE area_id = ?1",
              area_id));
  std::set<std::int64_t> spent(mapping.begin(), mapping.end());
  for (const std::int64_t version_id : versions) {
    SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version, GetVersionById(database, version_id));
    LedgerView view(database, version);
    for (const std::int64_t by : mapping) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool maps, view.Maps(by));
      if (maps) spent.erase(by);
    }
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement erase,
      database.Prepare("DELETE FROM mapped_evidence WHERE area_id = ?1 AND version_id = ?2 "
                       "AND begin_ns < ?3 AND end_ns < ?3"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement visibility,
      database.Prepare("DELETE FROM mapped_visibility WHERE version_id = ?1 AND run_id IN "
                       "(SELECT run_id FROM run WHERE end_ns < ?2)"));
  std::int64_t rows = 0;
  for (const std::int64_t by : spent) {
    erase.Bind(area_id, by, ToNanoseconds(before));
    SHIFTMAP_RETURN_IF_ERROR(erase.Execute());
    rows += database.Changes();
    visibility.Bind(by, ToNanoseconds(before));
    SHIFTMAP_RETURN_IF_ERROR(visibility.Execute());
  }
  return rows;
}

Status CompactEvidence(Database& database,
                       std::int64_t area_id,
                       const std::vector<std::int64_t>& versions,
                       Stamp before,
                       CompactResult* result) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<LedgerKey> spent,
                            FindSpentEvidence(database, area_id, versions, before));
  SHIFTMAP_RETURN_IF_ERROR(DeleteLedgerRows(database, area_id, spent));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t mapped,
                            DeleteSpentMapped(database, area_id, versions, before));
  result->evidence_rows += static_cast<std::int64_t>(spent.size()) + mapped;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement decisions,
      database.Prepare("DELETE FROM decision WHERE report_id IN (SELECT report_id "
                       "FROM shift_report JOIN version USING (version_id) "
                       "WHERE area_id = ?1 AND end_ns < ?2)"));
  decisions.Bind(area_id, ToNanoseconds(before));
  SHIFTMAP_RETURN_IF_ERROR(decisions.Execute());
  result->decisions += database.Changes();
  return DeleteOrphanedSummaries(database, area_id);
}

StatusOr<std::optional<VersionRow>> PublishedOf(Database& database, std::int64_t area_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::int64_t> published,
                            ReadIds(database,
                                    "SELECT published_version_id FROM area WHERE area_id = ?1 "
                                    "AND published_version_id IS NOT NULL",
                                    area_id));
  if (published.empty()) return std::optional<VersionRow>();
  SHIFTMAP_ASSIGN_OR_RETURN(VersionRow version, GetVersionById(database, published.front()));
  return std::optional(std::move(version));
}

std::string NameOf(const Database& database, const VersionRow& version) {
  return fmt::format("{}: version row {}", database.name(), version.version_id);
}

// Thins the ledger as the published version sees it. Checkpoints of what it was go.
Status ThinArea(Database& database, std::int64_t area_id, Stamp before, CompactResult* result) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<VersionRow> published,
                            PublishedOf(database, area_id));
  if (!published) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::int64_t rows,
      ThinLedger(database, area_id, *published, before, NameOf(database, *published)));
  if (rows == 0) return OkStatus();
  result->thinned_rows += rows;
  return DeleteCheckpointsAfter(database, area_id, Stamp::min()).status();
}

// Makes the checkpoints of the published versions anew. Without them a reader takes longer.
Status RenewCheckpoints(Database& database, const std::vector<std::int64_t>& areas) {
  for (const std::int64_t area_id : areas) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<VersionRow> published,
                              PublishedOf(database, area_id));
    if (!published) continue;
    SHIFTMAP_RETURN_IF_ERROR(ExtendCheckpoints(database,
                                               area_id,
                                               published->version_id,
                                               MapStore::OpenOptions().checkpoint_rows,
                                               NameOf(database, *published)));
  }
  return OkStatus();
}

Status CompactArea(Database& database,
                   std::int64_t area_id,
                   const RetentionPolicy& policy,
                   CompactResult* result) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::vector<std::int64_t> old,
      ReadIds(database,
              "SELECT version_id FROM version v WHERE area_id = ?1 AND content_stored = 1 "
              "AND version_id <> coalesce((SELECT published_version_id FROM area a "
              "WHERE a.area_id = ?1), 0) "
              "AND (SELECT count(*) FROM version n "
              "WHERE n.area_id = ?1 AND n.number > v.number) >= ?2 "
              // Builds that a version which is kept is an edit of.
              "AND NOT EXISTS (SELECT 1 FROM version e JOIN area a USING (area_id) "
              "WHERE e.edited_version_id = v.version_id AND (e.version_id = "
              "a.published_version_id OR (SELECT count(*) FROM version n "
              "WHERE n.area_id = ?1 AND n.number > e.number) < ?2))",
              area_id,
              policy.keep_versions));
  for (const std::int64_t version_id : old) {
    SHIFTMAP_RETURN_IF_ERROR(DeleteContent(database, version_id));
  }
  result->versions += static_cast<std::int64_t>(old.size());
  if (policy.thin_before) {
    SHIFTMAP_RETURN_IF_ERROR(ThinArea(database, area_id, *policy.thin_before, result));
  }
  if (!policy.evidence_before) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::vector<std::int64_t> kept,
      ReadIds(database,
              "SELECT version_id FROM version WHERE area_id = ?1 AND content_stored = 1",
              area_id));
  return CompactEvidence(database, area_id, kept, *policy.evidence_before, result);
}

}  // namespace

StatusOr<CompactResult> CompactStore(const std::string& path,
                                     const RetentionPolicy& policy,
                                     bool dry_run) {
  if (policy.keep_versions < 1) {
    return InvalidArgument(
        "map store '{}': keep {} versions, expected at least 1", path, policy.keep_versions);
  }
  Database::Options options;
  options.mode = Database::Mode::kReadWrite;
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, OpenStoreFile(path, options));
  CompactResult result;
  std::error_code error;
  result.bytes_before = std::filesystem::file_size(path, error);
  std::vector<std::int64_t> areas;
  {
    SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction,
                              Transaction::Begin(database, Transaction::Kind::kWrite));
    SHIFTMAP_ASSIGN_OR_RETURN(areas,
                              ReadIds(database, "SELECT area_id FROM area ORDER BY area_id"));
    for (const std::int64_t area_id : areas) {
      SHIFTMAP_RETURN_IF_ERROR(CompactArea(database, area_id, policy, &result));
    }
    SHIFTMAP_RETURN_IF_ERROR(InsertAudit(database,
                                         std::nullopt,
                                         AuditAction::kCompact,
                                         fmt::format("{} versions, {} evidence rows, {} thinned",
                                                     result.versions,
                                                     result.evidence_rows,
                                                     result.thinned_rows)));
    // Without Commit the transaction is rolled back.
    if (!dry_run) SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  }
  if (!dry_run) {
    if (result.thinned_rows > 0) SHIFTMAP_RETURN_IF_ERROR(RenewCheckpoints(database, areas));
    SHIFTMAP_RETURN_IF_ERROR(database.Execute("VACUUM"));
  }
  result.bytes_after = std::filesystem::file_size(path, error);
  return result;
}

StatusOr<std::int64_t> CompactVersions(const std::string& path,
                                       const std::string& area,
                                       const std::vector<VersionNumber>& versions) {
  Database::Options options;
  options.mode = Database::Mode::kReadWrite;
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, OpenStoreFile(path, options));
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction,
                            Transaction::Begin(database, Transaction::Kind::kWrite));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::vector<std::int64_t> areas,
      ReadIds(database, "SELECT area_id FROM area WHERE name = ?1", std::string_view(area)));
  if (areas.empty()) return NotFound("{}: no area '{}'", database.name(), area);
  std::vector<std::int64_t> compacted;
  for (const VersionNumber version : versions) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        const std::vector<std::int64_t> ids,
        ReadIds(database,
                "SELECT version_id FROM version v WHERE area_id = ?1 AND number = ?2 "
                "AND content_stored = 1 AND version_id <> coalesce("
                "(SELECT published_version_id FROM area a WHERE a.area_id = ?1), 0) "
                "AND NOT EXISTS (SELECT 1 FROM version c WHERE v.version_id IN "
                "(c.parent_version_id, c.edited_version_id)) "
                "AND NOT EXISTS (SELECT 1 FROM shift_report r WHERE r.version_id = v.version_id)",
                areas.front(),
                version.value()));
    for (const std::int64_t version_id : ids) {
      SHIFTMAP_RETURN_IF_ERROR(DeleteContent(database, version_id));
      SHIFTMAP_RETURN_IF_ERROR(DeleteMapped(database, version_id));
      compacted.push_back(version.value());
    }
  }
  if (compacted.empty()) return 0;
  SHIFTMAP_RETURN_IF_ERROR(InsertAudit(database,
                                       areas.front(),
                                       AuditAction::kCompact,
                                       fmt::format("content of {}", fmt::join(compacted, ", "))));
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  return static_cast<std::int64_t>(compacted.size());
}

}  // namespace shiftmap

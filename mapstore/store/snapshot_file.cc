// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/snapshot_file.h"

#include <set>
#include <utility>

#include "mapstore/schema/store_file.h"
#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/store/checkpoint_rows.h"
#include "mapstore/store/edit_rows.h"
#include "mapstore/store/ledger_view.h"

namespace shiftmap {
namespace {

template <typename... Values>
Status Run(Database& database, const char* sql, const Values&... values) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement statement, database.Prepare(sql));
  statement.Bind(values...);
  return statement.Execute();
}

Status CopyContent(Database& snapshot, std::int64_t version_id) {
  for (const char* sql :
       {"INSERT INTO main.landmark_group SELECT * FROM source.landmark_group WHERE version_id = ?1",
        "INSERT INTO main.mode SELECT * FROM source.mode WHERE version_id = ?1",
        "INSERT INTO main.merged_mode SELECT * FROM source.merged_mode WHERE version_id = ?1",
        "INSERT INTO main.mode_rate SELECT * FROM source.mode_rate WHERE version_id = ?1",
        "INSERT INTO main.mode_rhythm SELECT * FROM source.mode_rhythm WHERE version_id = ?1",
        "INSERT INTO main.mode_covariance "
        "SELECT * FROM source.mode_covariance WHERE version_id = ?1",
        "INSERT INTO main.anonymous_landmark "
        "SELECT * FROM source.anonymous_landmark WHERE version_id = ?1",
        "INSERT INTO main.vehicle_calibration "
        "SELECT * FROM source.vehicle_calibration WHERE version_id = ?1",
        "INSERT INTO main.stated_probability SELECT * FROM source.stated_probability "
        "WHERE version_id = (SELECT statement_version_id FROM source.version "
        "WHERE version_id = ?1)",
        "INSERT INTO main.run SELECT * FROM source.run WHERE run_id IN "
        "(SELECT run_id FROM source.version_run WHERE version_id = ?1 UNION "
        "SELECT run_id FROM main.mapped_evidence)",
        "INSERT INTO main.version_run (version_id, run_id, trajectory, checksum) "
        "SELECT version_id, run_id, x'', row_checksum(version_id, run_id, x'') "
        "FROM source.version_run WHERE version_id = ?1"}) {
    SHIFTMAP_RETURN_IF_ERROR(Run(snapshot, sql, version_id));
  }
  return OkStatus();
}

// A writer that waits for other readers keeps one out that comes then.
Status MetWriter(const Status& status) {
  if (status.code() != StatusCode::kUnavailable) return status;
  return MakeStatus(StatusCode::kAborted, "{}", Message(status));
}

// What the ledger of a snapshot refers to.
struct CopiedRows {
  std::set<std::int64_t> reports;
  std::set<std::int64_t> versions;
};

// Copies the reported rows that count and begin at `from` or later.
Status CopyReported(Database& source,
                    Database& snapshot,
                    std::int64_t area_id,
                    Stamp from,
                    LedgerView* view,
                    CopiedRows* copied) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      source.Prepare("SELECT begin_ns, end_ns, report_id, signature, version_id, "
                     "observation_count, log_likelihoods, checksum FROM visit_evidence "
                     "WHERE area_id = ?1 AND begin_ns >= ?2"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement insert,
      snapshot.Prepare("INSERT INTO main.visit_evidence (area_id, begin_ns, end_ns, report_id, "
                       "signature, version_id, observation_count, log_likelihoods, checksum) "
                       "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)"));
  rows.Bind(area_id, ToNanoseconds(from));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    const std::int64_t report_id = rows.Int64(2);
    const std::int64_t version_id = rows.Int64(4);
    SHIFTMAP_ASSIGN_OR_RETURN(
        const std::optional<SetAside> aside,
        view->JudgeReported(report_id, version_id, StampFromNanoseconds(rows.Int64(0))));
    if (aside) continue;
    copied->reports.insert(report_id);
    copied->versions.insert(version_id);
    insert.Bind(area_id,
                rows.Int64(0),
                rows.Int64(1),
                report_id,
                rows.Blob(3),
                version_id,
                rows.Int64(5),
                BlobView{rows.Blob(6)},
                rows.Int64(7));
    SHIFTMAP_RETURN_IF_ERROR(insert.Execute());
  }
}

// The same of the mapped rows.
Status CopyMapped(Database& source,
                  Database& snapshot,
                  std::int64_t area_id,
                  Stamp from,
                  LedgerView* view,
                  CopiedRows* copied) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement runs,
      source.Prepare("SELECT DISTINCT version_id, run_id FROM mapped_evidence "
                     "WHERE area_id = ?1 AND begin_ns >= ?2"));
  runs.Bind(area_id, ToNanoseconds(from));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, runs.Step());
    if (!row) return OkStatus();
    const std::int64_t version_id = runs.Int64(0);
    const std::int64_t run_id = runs.Int64(1);
    SHIFTMAP_ASSIGN_OR_RETURN(const bool counts, view->CountsMapped(version_id, run_id));
    if (!counts) continue;
    copied->versions.insert(version_id);
    SHIFTMAP_RETURN_IF_ERROR(Run(snapshot,
                                 "INSERT INTO main.mapped_evidence SELECT * "
                                 "FROM source.mapped_evidence WHERE area_id = ?1 "
                                 "AND begin_ns >= ?2 AND version_id = ?3 AND run_id = ?4",
                                 area_id,
                                 ToNanoseconds(from),
                                 version_id,
                                 run_id));
  }
}

// The rows of `version`, of the versions that reports refer to, and of those between them.
Status CopyVersions(Database& source,
                    Database& snapshot,
                    const VersionRow& version,
                    std::set<std::int64_t> versions) {
  versions.insert(version.version_id);
  const std::int64_t oldest = *versions.begin();
  for (const std::int64_t start : std::set<std::int64_t>(versions)) {
    SHIFTMAP_ASSIGN_OR_RETURN(VersionRow at, GetVersionById(source, start));
    while (at.parent_version_id && *at.parent_version_id >= oldest) {
      if (!versions.insert(*at.parent_version_id).second) break;
      SHIFTMAP_ASSIGN_OR_RETURN(at, GetVersionById(source, *at.parent_version_id));
    }
  }
  for (const std::int64_t version_id : versions) {
    SHIFTMAP_RETURN_IF_ERROR(
        Run(snapshot,
            "INSERT INTO main.version SELECT * FROM source.version WHERE version_id = ?1",
            version_id));
    if (version_id == version.version_id) continue;
    SHIFTMAP_RETURN_IF_ERROR(
        Run(snapshot,
            "UPDATE main.version SET content_stored = 0, configuration = '', statement_version_id "
            "= iif(version_id = ?2, statement_version_id, NULL) WHERE version_id = ?1",
            version_id,
            version.statement_version_id));
  }
  SHIFTMAP_RETURN_IF_ERROR(snapshot.Execute(
      "UPDATE main.version SET edited_version_id = NULL, parent_version_id = "
      "iif(parent_version_id IN (SELECT version_id FROM main.version), parent_version_id, NULL)"));
  return SetChecksums(snapshot, "version");
}

// The edits of the area, so that names follow. The versions that take them in are there.
Status CopyEdits(Database& snapshot, std::int64_t area_id) {
  SHIFTMAP_RETURN_IF_ERROR(
      Run(snapshot,
          "INSERT INTO main.map_edit SELECT * FROM source.map_edit WHERE area_id = ?1",
          area_id));
  SHIFTMAP_RETURN_IF_ERROR(snapshot.Execute("UPDATE main.map_edit SET kept_version_id = NULL"));
  SHIFTMAP_RETURN_IF_ERROR(SetChecksums(snapshot, "map_edit"));
  SHIFTMAP_RETURN_IF_ERROR(
      snapshot.Execute("INSERT INTO main.split_run SELECT * FROM source.split_run "
                       "WHERE edit_id IN (SELECT edit_id FROM main.map_edit)"));
  return snapshot.Execute(
      "INSERT INTO main.version_edit SELECT * FROM source.version_edit "
      "WHERE version_id IN (SELECT version_id FROM main.version)");
}

Status CopyRows(Database& source,
                Database& snapshot,
                std::int64_t area_id,
                const VersionRow& version,
                const MapContent& content,
                Stamp latest) {
  SHIFTMAP_RETURN_IF_ERROR(snapshot.Execute("PRAGMA defer_foreign_keys=ON"));
  SHIFTMAP_RETURN_IF_ERROR(Run(snapshot,
                               "INSERT INTO main.area (area_id, name, published_version_id, "
                               "checksum) SELECT area_id, name, ?2, row_checksum(name, ?2) "
                               "FROM source.area WHERE area_id = ?1",
                               area_id,
                               version.version_id));
  SHIFTMAP_ASSIGN_OR_RETURN(std::optional<Checkpoint> checkpoint,
                            FindCheckpoint(source, area_id, version.version_id, latest, content));
  if (checkpoint) {
    checkpoint->rows_stored = false;
    SHIFTMAP_RETURN_IF_ERROR(InsertCheckpoint(snapshot, area_id, version.version_id, *checkpoint));
  }
  const Stamp from = checkpoint ? checkpoint->before : Stamp::min();
  LedgerView view(source, version);
  CopiedRows copied;
  if (version.statement_version_id) copied.versions.insert(*version.statement_version_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::int64_t> edited,
                            EditedVersionsOfLine(source, version.version_id));
  copied.versions.insert(edited.begin(), edited.end());
  SHIFTMAP_RETURN_IF_ERROR(CopyReported(source, snapshot, area_id, from, &view, &copied));
  SHIFTMAP_RETURN_IF_ERROR(CopyMapped(source, snapshot, area_id, from, &view, &copied));
  for (const std::int64_t report_id : copied.reports) {
    SHIFTMAP_RETURN_IF_ERROR(
        Run(snapshot,
            "INSERT INTO main.shift_report SELECT * FROM source.shift_report WHERE report_id = ?1",
            report_id));
  }
  // What counts here is of the version's line, and nothing of the others is there.
  SHIFTMAP_RETURN_IF_ERROR(snapshot.Execute("UPDATE main.shift_report SET superseded = 0"));
  SHIFTMAP_RETURN_IF_ERROR(SetChecksums(snapshot, "shift_report"));
  SHIFTMAP_RETURN_IF_ERROR(CopyVersions(source, snapshot, version, copied.versions));
  SHIFTMAP_RETURN_IF_ERROR(CopyEdits(snapshot, area_id));
  return CopyContent(snapshot, version.version_id);
}

}  // namespace

StatusOr<SnapshotWriter> SnapshotWriter::Open(const Database& source,
                                              const std::string& path,
                                              std::chrono::milliseconds wait) {
  Database::Options options;
  options.busy_timeout = wait;
  options.mode = Database::Mode::kReadWriteCreate;
  SHIFTMAP_ASSIGN_OR_RETURN(Database snapshot, OpenStoreFile(path, options));
  // The caller syncs the whole file once, before anybody sees it.
  SHIFTMAP_RETURN_IF_ERROR(snapshot.Execute("PRAGMA synchronous=OFF"));
  SHIFTMAP_RETURN_IF_ERROR(MetWriter(Run(snapshot, "ATTACH ?1 AS source", source.read_uri())));
  return SnapshotWriter(std::move(snapshot));
}

Status SnapshotWriter::Begin() {
  SHIFTMAP_RETURN_IF_ERROR(MetWriter(snapshot_.Execute("BEGIN IMMEDIATE")));
  return MetWriter(snapshot_.QueryInt64("SELECT count(*) FROM source.area").status());
}

Status SnapshotWriter::Write(Database& source,
                             std::int64_t area_id,
                             const VersionRow& version,
                             const MapContent& content,
                             Stamp latest) {
  SHIFTMAP_RETURN_IF_ERROR(CopyRows(source, snapshot_, area_id, version, content, latest));
  SHIFTMAP_RETURN_IF_ERROR(snapshot_.Execute("COMMIT"));
  SHIFTMAP_RETURN_IF_ERROR(snapshot_.Execute("DETACH source"));
  return snapshot_.Execute("VACUUM");
}

}  // namespace shiftmap

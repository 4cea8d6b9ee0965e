// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/snapshot_file.h"

#include "mapstore/schema/store_file.h"
#include "mapstore/sqlite/transaction.h"

namespace shiftmap {
namespace {

template <typename... Values>
Status Run(Database& database, const char* sql, const Values&... values) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement statement, database.Prepare(sql));
  statement.Bind(values...);
  return statement.Execute();
}

// The columns of `version` are many and all copied, but for content_stored.
Status CopyVersion(Database& snapshot, std::int64_t version_id, bool content_stored) {
  SHIFTMAP_RETURN_IF_ERROR(
      Run(snapshot,
          "INSERT INTO main.version SELECT * FROM source.version WHERE version_id = ?1",
          version_id));
  return Run(snapshot,
             "UPDATE main.version SET content_stored = ?2 WHERE version_id = ?1",
             version_id,
             content_stored ? 1 : 0);
}

Status CopyContent(Database& snapshot, std::int64_t version_id) {
  for (const char* sql :
       {"INSERT INTO main.landmark_group SELECT * FROM source.landmark_group WHERE version_id = ?1",
        "INSERT INTO main.mode SELECT * FROM source.mode WHERE version_id = ?1",
        "INSERT INTO main.mode_covariance "
        "SELECT * FROM source.mode_covariance WHERE version_id = ?1",
        "INSERT INTO main.anonymous_landmark "
        "SELECT * FROM source.anonymous_landmark WHERE version_id = ?1",
        "INSERT INTO main.run SELECT * FROM source.run WHERE run_id IN "
        "(SELECT run_id FROM source.version_run WHERE version_id = ?1)",
        "INSERT INTO main.version_run (version_id, run_id, trajectory) "
        "SELECT version_id, run_id, x'' FROM source.version_run WHERE version_id = ?1"}) {
    SHIFTMAP_RETURN_IF_ERROR(Run(snapshot, sql, version_id));
  }
  return OkStatus();
}

// Of an ancestor only visits that began after the version's stamp count.
Status CopyEvidence(Database& snapshot,
                    std::int64_t area_id,
                    const VersionRow& reported,
                    const VersionRow& published) {
  const Stamp after = reported.version_id == published.version_id ? Stamp::min() : published.stamp;
  return Run(snapshot,
             "INSERT INTO main.visit_evidence SELECT e.* FROM source.visit_evidence e "
             "JOIN source.shift_report r USING (report_id) "
             "WHERE e.area_id = ?1 AND r.version_id = ?2 AND e.begin_ns > ?3",
             area_id,
             reported.version_id,
             ToNanoseconds(after));
}

Status CopyRows(Database& snapshot, std::int64_t area_id, const std::vector<VersionRow>& lineage) {
  const VersionRow& published = lineage.front();
  SHIFTMAP_RETURN_IF_ERROR(snapshot.Execute("PRAGMA defer_foreign_keys=ON"));
  SHIFTMAP_RETURN_IF_ERROR(Run(snapshot,
                               "INSERT INTO main.area (area_id, name, published_version_id) "
                               "SELECT area_id, name, ?2 FROM source.area WHERE area_id = ?1",
                               area_id,
                               published.version_id));
  for (const VersionRow& version : lineage) {
    const bool content_stored = version.version_id == published.version_id;
    SHIFTMAP_RETURN_IF_ERROR(CopyVersion(snapshot, version.version_id, content_stored));
    SHIFTMAP_RETURN_IF_ERROR(CopyEvidence(snapshot, area_id, version, published));
  }
  SHIFTMAP_RETURN_IF_ERROR(
      Run(snapshot,
          "INSERT INTO main.shift_report SELECT * FROM source.shift_report WHERE report_id IN "
          "(SELECT report_id FROM main.visit_evidence)"));
  return CopyContent(snapshot, published.version_id);
}

}  // namespace

Status WriteSnapshotFile(Database& source,
                         std::int64_t area_id,
                         const std::vector<VersionRow>& lineage,
                         const std::string& path) {
  Database::Options options;
  options.mode = Database::Mode::kReadWriteCreate;
  SHIFTMAP_ASSIGN_OR_RETURN(Database snapshot, OpenStoreFile(path, options));
  // The caller syncs the whole file once, before anybody sees it.
  SHIFTMAP_RETURN_IF_ERROR(snapshot.Execute("PRAGMA synchronous=OFF"));
  SHIFTMAP_RETURN_IF_ERROR(Run(snapshot, "ATTACH ?1 AS source", source.read_uri()));
  {
    SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction,
                              Transaction::Begin(snapshot, Transaction::Kind::kWrite));
    SHIFTMAP_RETURN_IF_ERROR(CopyRows(snapshot, area_id, lineage));
    SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  }
  SHIFTMAP_RETURN_IF_ERROR(snapshot.Execute("DETACH source"));
  return snapshot.Execute("VACUUM");
}

}  // namespace shiftmap

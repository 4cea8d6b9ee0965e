// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/provenance_rows.h"

#include <optional>
#include <utility>

#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/store/blob.h"
#include "mapstore/store/mapped_rows.h"
#include "mapstore/store/visibility_rows.h"

namespace shiftmap {
namespace {

StatusOr<std::int64_t> FindOrInsertRun(Database& database, const RunRecord& run) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement insert,
      database.Prepare(InsertRowSql("run", "sha256, name, vehicle, begin_ns, end_ns, identity") +
                       " ON CONFLICT DO NOTHING"));
  insert.Bind(run.sha256,
              run.name,
              run.vehicle,
              ToNanoseconds(run.begin),
              ToNanoseconds(run.end),
              run.identity());
  SHIFTMAP_RETURN_IF_ERROR(insert.Execute());
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement find,
      database.Prepare("SELECT run_id FROM run WHERE sha256 = ?1 AND name = ?2 AND vehicle = ?3 "
                       "AND begin_ns = ?4 AND end_ns = ?5"));
  find.Bind(run.sha256, run.name, run.vehicle, ToNanoseconds(run.begin), ToNanoseconds(run.end));
  SHIFTMAP_RETURN_IF_ERROR(find.Step().status());
  return find.Int64(0);
}

// RunRecord::uuid from what identifies the run.
std::string UuidOf(const std::string& identity, const std::string& sha256) {
  return identity == sha256 ? "" : identity;
}

// Of a row that begins with name, sha256, vehicle, begin_ns, end_ns, identity.
RunRecord RunAt(const Statement& row) {
  RunRecord run;
  run.name = row.Text(0);
  run.sha256 = row.Text(1);
  run.vehicle = row.Text(2);
  run.begin = StampFromNanoseconds(row.Int64(3));
  run.end = StampFromNanoseconds(row.Int64(4));
  run.uuid = UuidOf(row.Text(5), run.sha256);
  return run;
}

StatusOr<std::vector<RunRecord>> ReadRuns(Database& database,
                                          std::int64_t version_id,
                                          const std::string& owner) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT name, sha256, vehicle, begin_ns, end_ns, identity, trajectory "
                       "FROM version_run JOIN run USING (run_id) WHERE version_id = ?1 "
                       "ORDER BY begin_ns, sha256, name"));
  query.Bind(version_id);
  std::vector<RunRecord> runs;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return runs;
    RunRecord run = RunAt(query);
    std::optional<std::vector<TrajectoryPose>> trajectory = UnpackTrajectory(query.Blob(6));
    if (!trajectory) return DataLoss("{}: run '{}': trajectory is damaged", owner, run.name);
    run.trajectory = *std::move(trajectory);
    runs.push_back(std::move(run));
  }
}

}  // namespace

Status InsertRuns(Database& database,
                  std::int64_t area_id,
                  std::int64_t version_id,
                  const std::vector<RunRecord>& runs) {
  for (const RunRecord& run : runs) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t run_id, FindOrInsertRun(database, run));
    // The same run named twice is one run.
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement row,
        database.Prepare(InsertRowSql("version_run", "version_id, run_id, trajectory") +
                         " ON CONFLICT DO NOTHING"));
    const std::string trajectory = PackTrajectory(run.trajectory);
    row.Bind(version_id, run_id, BlobView{trajectory});
    SHIFTMAP_RETURN_IF_ERROR(row.Execute());
    SHIFTMAP_RETURN_IF_ERROR(
        InsertMappedEvidence(database, area_id, version_id, run_id, run.evidence));
    SHIFTMAP_RETURN_IF_ERROR(InsertVisibility(database, version_id, run_id, run.visibility));
  }
  return OkStatus();
}

Status InsertOlderEvidence(Database& database,
                           std::int64_t area_id,
                           std::int64_t version_id,
                           const std::vector<RunRecord>& runs) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement find,
      database.Prepare("SELECT min(run_id) FROM run WHERE sha256 = ?1 AND run_id IN "
                       "(SELECT run_id FROM version_run JOIN version USING (version_id) "
                       "WHERE area_id = ?2)"));
  for (const RunRecord& run : runs) {
    find.Bind(run.sha256, area_id);
    SHIFTMAP_RETURN_IF_ERROR(find.Step().status());
    SHIFTMAP_RETURN_IF_ERROR(
        InsertMappedEvidence(database, area_id, version_id, find.Int64(0), run.evidence));
  }
  return OkStatus();
}

StatusOr<Provenance> ReadProvenance(Database& database,
                                    std::int64_t version_id,
                                    const std::string& owner) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT tool, configuration, seed FROM version WHERE version_id = ?1"));
  query.Bind(version_id);
  SHIFTMAP_RETURN_IF_ERROR(query.Step().status());
  Provenance provenance;
  provenance.tool = query.Text(0);
  provenance.configuration = query.Text(1);
  provenance.seed = query.Int64(2);
  SHIFTMAP_ASSIGN_OR_RETURN(provenance.runs, ReadRuns(database, version_id, owner));
  return provenance;
}

StatusOr<std::vector<LineRun>> ReadLineRuns(Database& database, std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("WITH RECURSIVE line(version_id) AS (VALUES (?1) UNION "
                       "SELECT parent_version_id FROM version JOIN line USING (version_id) "
                       "WHERE parent_version_id IS NOT NULL) "
                       "SELECT name, sha256, vehicle, begin_ns, end_ns, identity, min(number), "
                       "min(created_ns) FROM line JOIN version USING (version_id) "
                       "JOIN version_run USING (version_id) JOIN run USING (run_id) "
                       "GROUP BY run_id ORDER BY begin_ns, name"));
  query.Bind(version_id);
  std::vector<LineRun> runs;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return runs;
    runs.push_back(
        {RunAt(query), VersionNumber(query.Int64(6)), StampFromNanoseconds(query.Int64(7))});
  }
}

StatusOr<std::set<std::string>> ReadRunIdentities(Database& database, std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<LineRun> runs, ReadLineRuns(database, version_id));
  std::set<std::string> identities;
  for (const LineRun& line : runs) identities.insert({line.run.sha256, line.run.identity()});
  return identities;
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <vector>

#include "mapstore/core/clock.h"
#include "mapstore/maintenance/verify_rows.h"
#include "mapstore/schema/store_file.h"
#include "mapstore/store/blob.h"
#include "mapstore/store/report_rows.h"
#include "mapstore/store/visibility_rows.h"

namespace shiftmap {
namespace {

// Adds a defect for each row of a query: (key, problem).
Status AddRows(Database& database,
               const std::string& table,
               std::string_view sql,
               DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement rows, database.Prepare(sql));
  rows.Bind();
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    defects->Add(table, rows.Text(0), rows.Text(1));
  }
}

Status VerifyReports(Database& database, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(defects->result().reports,
                            database.QueryInt64("SELECT count(*) FROM shift_report"));
  SHIFTMAP_RETURN_IF_ERROR(
      AddRows(database,
              "shift_report",
              "SELECT uuid, 'ends before it begins' FROM shift_report WHERE end_ns < begin_ns",
              defects));
  SHIFTMAP_RETURN_IF_ERROR(
      AddRows(database,
              "shift_report",
              fmt::format("SELECT uuid, 'its place among the reports about its run is wrong' "
                          "FROM shift_report x WHERE superseded <> EXISTS (SELECT 1 {} AND {})",
                          SameRunSql("x.report_id"),
                          kComesBeforeSql),
              defects));
  return AddRows(
      database,
      "mapped_report",
      "SELECT uuid, 'is not about a run of the version' FROM mapped_report m "
      "JOIN shift_report r USING (report_id) WHERE NOT EXISTS (SELECT 1 FROM run "
      "JOIN version_run vr USING (run_id) WHERE "
      "(run.identity = r.identity OR sha256 = r.run_hash OR "
      "(run.vehicle = r.vehicle AND run.begin_ns = r.begin_ns)) AND vr.version_id = m.version_id)",
      defects);
}

// Adds a defect for each visit that a query finds a problem with, or of which the log-likelihoods
// do not unpack: (key, signature, begin in ns, problem or NULL, log-likelihoods).
Status VerifyVisits(Database& database,
                    const std::string& table,
                    std::string_view sql,
                    DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement rows, database.Prepare(sql));
  rows.Bind();
  std::vector<VisitEvidence::ModeLogLikelihood> modes;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    ++defects->result().evidence_rows;
    std::string problem = rows.Text(3);
    if (problem.empty() && !UnpackLogLikelihoods(rows.Blob(4), &modes)) {
      problem = "log-likelihoods are damaged";
    }
    if (problem.empty()) continue;
    defects->Add(table,
                 fmt::format("{}, '{}' at {} ns", rows.Text(0), rows.Text(1), rows.Int64(2)),
                 problem);
  }
}

Status VerifyEvidence(Database& database, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(const bool snapshot, IsSnapshot(database));
  SHIFTMAP_RETURN_IF_ERROR(
      VerifyVisits(database,
                   "visit_evidence",
                   "SELECT 'report ' || coalesce(r.uuid, ''), e.signature, e.begin_ns, CASE "
                   "WHEN NOT coalesce(e.version_id = r.version_id AND e.area_id = v.area_id, 0) "
                   "THEN 'its area or version is not that of its report' "
                   "WHEN e.end_ns < e.begin_ns THEN 'ends before it begins' "
                   "WHEN NOT coalesce(e.begin_ns >= r.first_visit_ns, 0) "
                   "THEN 'begins before the first visit of its report' END, e.log_likelihoods "
                   "FROM visit_evidence e LEFT JOIN shift_report r USING (report_id) "
                   "LEFT JOIN version v ON v.version_id = r.version_id",
                   defects));
  // A snapshot has the runs of its own version only.
  const std::string of_version =
      snapshot ? ""
               : "WHEN v.content_stored <> 0 AND NOT EXISTS (SELECT 1 FROM version_run vr "
                 "WHERE vr.version_id <= e.version_id AND vr.run_id = e.run_id) "
                 "THEN 'its run is not of its version, or of one before' ";
  return VerifyVisits(
      database,
      "mapped_evidence",
      "SELECT 'run ' || quote(coalesce(r.name, '')), e.signature, e.begin_ns, CASE "
      "WHEN NOT coalesce(e.area_id = v.area_id, 0) THEN 'its area is not that of its version' " +
          of_version +
          "WHEN e.end_ns < e.begin_ns THEN 'ends before it begins' END, e.log_likelihoods "
          "FROM mapped_evidence e LEFT JOIN run r USING (run_id) "
          "LEFT JOIN version v ON v.version_id = e.version_id",
      defects);
}

Status VerifyVisibility(Database& database, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT r.name, m.signature, m.mode, m.scans, EXISTS (SELECT 1 "
                       "FROM version_run vr WHERE vr.version_id = m.version_id "
                       "AND vr.run_id = m.run_id) FROM mapped_visibility m JOIN run r "
                       "USING (run_id)"));
  rows.Bind();
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    std::string problem;
    if (rows.Int64(4) == 0) problem = "its run is not of its version";
    if (!UnpackScans(rows.Blob(3))) problem = "counts of scans are damaged";
    if (problem.empty()) continue;
    defects->Add("mapped_visibility",
                 fmt::format("run '{}', '{}', mode {}", rows.Text(0), rows.Text(1), rows.Int64(2)),
                 problem);
  }
}

Status VerifySightings(Database& database, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT uuid, sighting_index, x_m, y_m, cov_xx_m2, cov_xy_m2, cov_yy_m2, "
                       "count, s.area_id = v.area_id FROM sighting s JOIN shift_report r "
                       "USING (report_id) JOIN version v USING (version_id)"));
  rows.Bind();
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    bool sound = rows.Int64(7) >= 1 && rows.Int64(8) == 1;
    for (int column = 2; column <= 6; ++column) {
      sound = sound && std::isfinite(rows.Double(column));
    }
    // A report may say that it knows a position exactly.
    sound = sound && rows.Double(4) >= 0.0 && rows.Double(6) >= 0.0 &&
            rows.Double(4) * rows.Double(6) >= rows.Double(5) * rows.Double(5) * (1.0 - 1e-9);
    if (sound) continue;
    defects->Add("sighting",
                 fmt::format("report {}, sighting {}", rows.Text(0), rows.Int64(1)),
                 "area, position, covariance or count is wrong");
  }
}

// Adds a finding if the query, of (count, newest stamp), counts any.
Status CountFuture(Database& database, std::string_view sql, Stamp now, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare(sql));
  query.Bind(ToNanoseconds(now + FromSeconds(kDefaultClockToleranceS)));
  SHIFTMAP_RETURN_IF_ERROR(query.Step().status());
  if (query.Int64(0) == 0) return OkStatus();
  defects->result().findings.push_back(
      fmt::format("{} {} ahead of this host's clock: newest stamp {} UTC, but it is {} UTC",
                  query.Int64(0),
                  query.Text(2),
                  FormatUtc(StampFromNanoseconds(query.Int64(1))),
                  FormatUtc(now)));
  return OkStatus();
}

}  // namespace

Status FindFutureStamps(Database& database, DefectList* defects) {
  const Stamp now = SystemNow();
  SHIFTMAP_RETURN_IF_ERROR(
      CountFuture(database,
                  "SELECT count(*), max(stamp_ns), 'versions' FROM version WHERE stamp_ns > ?1",
                  now,
                  defects));
  return CountFuture(database,
                     "SELECT count(*), max(end_ns), 'visits' FROM (SELECT end_ns "
                     "FROM visit_evidence UNION ALL SELECT end_ns FROM mapped_evidence) "
                     "WHERE end_ns > ?1",
                     now,
                     defects);
}

Status VerifyLedger(Database& database, DefectList* defects) {
  SHIFTMAP_RETURN_IF_ERROR(VerifyReports(database, defects));
  SHIFTMAP_RETURN_IF_ERROR(VerifyEvidence(database, defects));
  SHIFTMAP_RETURN_IF_ERROR(VerifyVisibility(database, defects));
  SHIFTMAP_RETURN_IF_ERROR(
      AddRows(database,
              "ledger_summary",
              "SELECT signature || ' at ' || begin_ns || ' ns', 'stands for no row, or its counts "
              "are wrong' FROM ledger_summary s WHERE visits < 2 OR steps < 1 OR steps >= visits "
              "OR NOT gap_s >= 0.0 OR NOT EXISTS (SELECT 1 FROM visit_evidence e WHERE "
              "(e.area_id, e.begin_ns, e.end_ns, e.report_id, e.signature) = "
              "(s.area_id, s.begin_ns, s.end_ns, s.report_id, s.signature) UNION ALL "
              "SELECT 1 FROM mapped_evidence e WHERE s.report_id = 0 AND "
              "(e.area_id, e.begin_ns, e.end_ns, e.version_id, e.run_id, e.signature) = "
              "(s.area_id, s.begin_ns, s.end_ns, s.version_id, s.run_id, s.signature))",
              defects));
  SHIFTMAP_RETURN_IF_ERROR(
      AddRows(database,
              "decision",
              "SELECT uuid || ', decision ' || decision_index, 'mode or log odds are wrong' "
              "FROM decision JOIN shift_report USING (report_id) "
              "WHERE mode < 0 OR signature = '' OR NOT abs(log_odds) < 1e300",
              defects));
  return VerifySightings(database, defects);
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/report_rows.h"

#include <algorithm>
#include <set>
#include <tuple>
#include <utility>

#include "mapstore/core/clock.h"
#include "mapstore/map/shift_report_check.h"
#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/store/blob.h"

namespace shiftmap {
namespace {

auto KeyOf(const VisitEvidence& visit) { return std::tie(visit.begin, visit.end, visit.signature); }

// In the order of the key: the rows of a report are neighbours in the file.
std::vector<const VisitEvidence*> ByTime(const std::vector<VisitEvidence>& evidence) {
  std::vector<const VisitEvidence*> rows;
  rows.reserve(evidence.size());
  for (const VisitEvidence& visit : evidence) rows.push_back(&visit);
  std::sort(rows.begin(), rows.end(), [](const VisitEvidence* a, const VisitEvidence* b) {
    return KeyOf(*a) < KeyOf(*b);
  });
  return rows;
}

Status InsertEvidence(Database& database,
                      std::int64_t area_id,
                      std::int64_t report_id,
                      std::int64_t version_id,
                      const ShiftReport& report) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(InsertRowSql("visit_evidence",
                                    "area_id, begin_ns, end_ns, report_id, signature, version_id, "
                                    "observation_count, log_likelihoods")));
  for (const VisitEvidence* evidence : ByTime(report.evidence)) {
    const std::string log_likelihoods = PackLogLikelihoods(evidence->modes);
    row.Bind(area_id,
             ToNanoseconds(evidence->begin),
             ToNanoseconds(evidence->end),
             report_id,
             evidence->signature.text(),
             version_id,
             evidence->observations,
             BlobView{log_likelihoods});
    SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  }
  return OkStatus();
}

Status InsertDecisions(Database& database, std::int64_t report_id, const ShiftReport& report) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(InsertRowSql(
          "decision", "report_id, decision_index, signature, mode, stamp_ns, log_odds")));
  std::int64_t index = 0;
  for (const Decision& decision : report.decisions) {
    row.Bind(report_id,
             index++,
             decision.signature.text(),
             decision.mode.value(),
             ToNanoseconds(decision.stamp),
             decision.log_odds);
    SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  }
  return OkStatus();
}

Status InsertSightings(Database& database,
                       std::int64_t area_id,
                       std::int64_t report_id,
                       const ShiftReport& report) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(InsertRowSql(
          "sighting",
          "report_id, sighting_index, area_id, signature, x_m, y_m, cov_xx_m2, cov_xy_m2, "
          "cov_yy_m2, count, first_ns, last_ns")));
  std::int64_t index = 0;
  for (const UnmappedSighting& sighting : report.sightings) {
    row.Bind(report_id,
             index++,
             area_id,
             sighting.signature.text(),
             sighting.p_map_landmark.x(),
             sighting.p_map_landmark.y(),
             sighting.cov_p_map_landmark(0, 0),
             sighting.cov_p_map_landmark(0, 1),
             sighting.cov_p_map_landmark(1, 1),
             sighting.count,
             ToNanoseconds(sighting.first),
             ToNanoseconds(sighting.last));
    SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  }
  return OkStatus();
}

// As shift_report.identity has it.
std::string IdentityOf(const ShiftReport& report) {
  if (!report.run_uuid.empty()) return LowerCaseUuid(report.run_uuid);
  return report.run_hash.empty() ? LowerCaseUuid(report.uuid) : report.run_hash;
}

std::optional<std::int64_t> NanosecondsOf(const std::optional<Stamp>& stamp) {
  return stamp ? std::optional(ToNanoseconds(*stamp)) : std::nullopt;
}

void Widen(std::optional<Stamp> first_visit, std::optional<Stamp>* from) {
  if (first_visit) *from = std::min(from->value_or(*first_visit), *first_visit);
}

// Notes which of the reports about the run of a new one do not come first.
Status OrderAmongSameRun(Database& database, InsertedReport* inserted) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement others,
      database.Prepare(fmt::format(
          "SELECT o.report_id, o.first_visit_ns, {} {}", kComesBeforeSql, SameRunSql())));
  others.Bind(inserted->report_id);
  std::set<std::int64_t> superseded;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, others.Step());
    if (!row) break;
    if (others.Int64(2) != 0) {
      superseded.insert(inserted->report_id);
      continue;
    }
    if (!others.IsNull(1)) Widen(StampFromNanoseconds(others.Int64(1)), &inserted->changed_from);
    superseded.insert(others.Int64(0));
  }
  for (const std::int64_t report_id : superseded) {
    const std::string key = fmt::format("report_id = {}", report_id);
    SHIFTMAP_RETURN_IF_ERROR(
        database.Execute("UPDATE shift_report SET superseded = 1 WHERE " + key));
    SHIFTMAP_RETURN_IF_ERROR(SetChecksums(database, "shift_report", key));
  }
  return OkStatus();
}

// Notes which versions were built from runs that reports are about. The areas have a plus so that
// SQLite finds the runs, and the reports, by their own indices.
// @param which  Of which reports or versions: SQL with one parameter.
Status InsertMappedReports(Database& database, const char* which, std::int64_t id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(fmt::format(
          "INSERT INTO mapped_report (report_id, version_id, checksum) "
          "SELECT report_id, version_id, row_checksum(report_id, version_id) FROM ("
          "SELECT r.report_id AS report_id, v.version_id AS version_id "
          "FROM shift_report r JOIN version rv ON rv.version_id = r.version_id, "
          "run JOIN version_run USING (run_id) JOIN version v ON v.version_id = "
          "version_run.version_id WHERE {} AND +v.area_id = +rv.area_id AND "
          "(run.identity = r.identity OR (run.sha256 = r.run_hash AND r.run_hash <> '') "
          "OR (run.begin_ns = r.begin_ns AND run.vehicle = r.vehicle AND r.begin_ns >= {} "
          "AND r.run_hash <> '' AND (r.identity = r.run_hash OR run.identity = run.sha256)))) "
          "WHERE true ON CONFLICT DO NOTHING",
          which,
          ToNanoseconds(kFirstPlausibleStamp))));
  row.Bind(id);
  return row.Execute();
}

}  // namespace

StatusOr<bool> HasReport(Database& database, const std::string& uuid) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query,
                            database.Prepare("SELECT 1 FROM shift_report WHERE uuid = ?1"));
  const std::string key = LowerCaseUuid(uuid);
  query.Bind(key);
  return query.Step();
}

StatusOr<InsertedReport> InsertReport(Database& database,
                                      std::int64_t area_id,
                                      const VersionRow& version,
                                      const ShiftReport& report,
                                      Stamp received) {
  const std::string uuid = LowerCaseUuid(report.uuid);
  std::optional<Stamp> first_visit;
  for (const VisitEvidence& evidence : report.evidence) Widen(evidence.begin, &first_visit);
  InsertedReport inserted;
  inserted.changed_from = first_visit;
  const std::string identity = IdentityOf(report);
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(InsertRowSql(
          "shift_report",
          "uuid, version_id, vehicle, run_hash, software, begin_ns, end_ns, received_ns, "
          "first_visit_ns, superseded, identity")));
  row.Bind(uuid,
           version.version_id,
           report.vehicle,
           report.run_hash,
           report.software,
           ToNanoseconds(report.begin),
           ToNanoseconds(report.end),
           ToNanoseconds(received),
           NanosecondsOf(first_visit),
           0,
           identity);
  SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  inserted.report_id = database.LastInsertRowId();
  inserted.run = identity;
  inserted.received = received;
  SHIFTMAP_RETURN_IF_ERROR(OrderAmongSameRun(database, &inserted));
  SHIFTMAP_RETURN_IF_ERROR(InsertMappedReports(database, "r.report_id = ?1", inserted.report_id));
  SHIFTMAP_RETURN_IF_ERROR(
      InsertEvidence(database, area_id, inserted.report_id, version.version_id, report));
  SHIFTMAP_RETURN_IF_ERROR(InsertDecisions(database, inserted.report_id, report));
  SHIFTMAP_RETURN_IF_ERROR(InsertSightings(database, area_id, inserted.report_id, report));
  return inserted;
}

StatusOr<bool> IsKnownOtherwise(Database& database, std::int64_t report_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT 1 FROM shift_report r WHERE report_id = ?1 AND (EXISTS (SELECT 1 "
                       "FROM run WHERE identity = r.identity) OR EXISTS (SELECT 1 FROM "
                       "shift_report WHERE identity = r.identity AND report_id <> ?1))"));
  query.Bind(report_id);
  return query.Step();
}

Status InsertMappedReports(Database& database, std::int64_t version_id) {
  return InsertMappedReports(database, "v.version_id = ?1", version_id);
}

std::string SameRunSql(std::string_view report) {
  return fmt::format(
      "FROM shift_report r JOIN version v ON v.version_id = r.version_id "
      "JOIN shift_report o ON o.vehicle = r.vehicle AND o.report_id <> r.report_id "
      "AND (o.identity = r.identity OR (o.begin_ns = r.begin_ns AND r.begin_ns >= {} "
      "AND o.run_hash <> '' AND r.run_hash <> '' "
      "AND (o.identity = o.run_hash OR r.identity = r.run_hash) "
      "AND o.first_visit_ns <= r.end_ns AND r.first_visit_ns <= o.end_ns)) "
      "JOIN version ov ON ov.version_id = o.version_id AND ov.area_id = v.area_id "
      "WHERE r.report_id = {}",
      ToNanoseconds(kFirstPlausibleStamp),
      report);
}

StatusOr<LedgerPosition> ReadLedgerPosition(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::int64_t position,
      database.QueryInt64("SELECT coalesce(max(report_id), 0) FROM shift_report"));
  return LedgerPosition(position);
}

StatusOr<std::vector<UnmappedSighting>> ReadSightings(Database& database, std::int64_t area_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT signature, x_m, y_m, cov_xx_m2, cov_xy_m2, cov_yy_m2, count, "
                       "first_ns, last_ns FROM sighting JOIN shift_report USING (report_id) "
                       "WHERE area_id = ?1 ORDER BY last_ns DESC, uuid, sighting_index"));
  query.Bind(area_id);
  std::vector<UnmappedSighting> sightings;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return sightings;
    UnmappedSighting sighting;
    sighting.signature = Signature(query.Text(0));
    sighting.p_map_landmark = {query.Double(1), query.Double(2)};
    sighting.cov_p_map_landmark << query.Double(3), query.Double(4), query.Double(4),
        query.Double(5);
    sighting.count = query.Int64(6);
    sighting.first = StampFromNanoseconds(query.Int64(7));
    sighting.last = StampFromNanoseconds(query.Int64(8));
    sightings.push_back(std::move(sighting));
  }
}

}  // namespace shiftmap

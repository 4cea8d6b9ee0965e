// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/report_rows.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "mapstore/core/clock.h"
#include "mapstore/map/shift_report_check.h"
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
      database.Prepare("INSERT INTO visit_evidence (area_id, begin_ns, end_ns, report_id, "
                       "signature, version_id, observation_count, log_likelihoods) "
                       "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)"));
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
      database.Prepare("INSERT INTO decision (report_id, decision_index, signature, mode, "
                       "stamp_ns, log_odds) VALUES (?1, ?2, ?3, ?4, ?5, ?6)"));
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
      database.Prepare("INSERT INTO sighting (report_id, sighting_index, area_id, signature, x_m, "
                       "y_m, cov_xx_m2, cov_xy_m2, cov_yy_m2, count, first_ns, last_ns) "
                       "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)"));
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

// Of several reports of a vehicle about one run that against the lowest version comes first, then
// that of the lowest UUID, whatever the order in which they came. Notes which do not come first.
// @return Whether another one comes before this.
StatusOr<bool> OrderAmongSameRun(Database& database,
                                 std::int64_t area_id,
                                 const VersionRow& version,
                                 const ShiftReport& report,
                                 InsertedReport* inserted) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement others,
      database.Prepare("SELECT report_id, first_visit_ns, number, uuid "
                       "FROM shift_report r JOIN version v USING (version_id) "
                       "WHERE identity = ?1 AND area_id = ?2 AND vehicle = ?3 UNION "
                       "SELECT report_id, first_visit_ns, number, uuid "
                       "FROM shift_report r JOIN version v USING (version_id) WHERE report_id IN "
                       "(SELECT report_id FROM visit_evidence WHERE area_id = ?2 AND begin_ns "
                       "BETWEEN ?4 AND ?5) "
                       "AND vehicle = ?3 AND begin_ns = ?4 AND ?4 >= ?6 AND ?7 <= end_ns "
                       "AND ?9 <> '' AND run_hash <> '' AND (?8 OR identity = run_hash)"));
  const std::string uuid = LowerCaseUuid(report.uuid);
  const std::string identity = IdentityOf(report);
  others.Bind(identity,
              area_id,
              report.vehicle,
              ToNanoseconds(report.begin),
              ToNanoseconds(report.end),
              ToNanoseconds(kFirstPlausibleStamp),
              NanosecondsOf(inserted->changed_from),
              report.run_uuid.empty() ? 1 : 0,
              report.run_hash);
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement update,
      database.Prepare("UPDATE shift_report SET superseded = 1 WHERE report_id = ?1"));
  bool superseded = false;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, others.Step());
    if (!row) return superseded;
    const auto other = std::make_tuple(VersionNumber(others.Int64(2)), others.Text(3));
    if (other < std::make_tuple(version.number, uuid)) {
      superseded = true;
      continue;
    }
    if (!others.IsNull(1)) Widen(StampFromNanoseconds(others.Int64(1)), &inserted->changed_from);
    update.Bind(others.Int64(0));
    SHIFTMAP_RETURN_IF_ERROR(update.Execute());
  }
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
  const std::optional<std::int64_t> first_visit_ns = NanosecondsOf(first_visit);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool superseded,
                            OrderAmongSameRun(database, area_id, version, report, &inserted));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("INSERT INTO shift_report (uuid, version_id, vehicle, run_hash, software, "
                       "begin_ns, end_ns, received_ns, first_visit_ns, superseded, identity) "
                       "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11)"));
  row.Bind(uuid,
           version.version_id,
           report.vehicle,
           report.run_hash,
           report.software,
           ToNanoseconds(report.begin),
           ToNanoseconds(report.end),
           ToNanoseconds(received),
           first_visit_ns,
           superseded ? 1 : 0,
           identity);
  SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  inserted.report_id = database.LastInsertRowId();
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement mapped,
      database.Prepare(
          "INSERT INTO mapped_report (report_id, version_id) "
          "SELECT ?1, version_id FROM run JOIN version_run USING (run_id) "
          "WHERE identity = ?2 OR (sha256 = ?3 AND ?3 <> '') UNION "
          "SELECT ?1, version_id FROM run JOIN version_run USING (run_id) "
          "WHERE (run_id, version_id) IN (SELECT run_id, version_id FROM mapped_evidence "
          "WHERE area_id = ?4 AND begin_ns BETWEEN ?5 AND ?6) "
          "AND vehicle = ?7 AND begin_ns = ?5 AND ?5 >= ?8 AND ?9 <= end_ns "
          "AND ?3 <> '' AND (?10 OR identity = sha256)"));
  mapped.Bind(inserted.report_id,
              identity,
              report.run_hash,
              area_id,
              ToNanoseconds(report.begin),
              ToNanoseconds(report.end),
              report.vehicle,
              ToNanoseconds(kFirstPlausibleStamp),
              first_visit_ns,
              report.run_uuid.empty() ? 1 : 0);
  SHIFTMAP_RETURN_IF_ERROR(mapped.Execute());
  SHIFTMAP_RETURN_IF_ERROR(
      InsertEvidence(database, area_id, inserted.report_id, version.version_id, report));
  SHIFTMAP_RETURN_IF_ERROR(InsertDecisions(database, inserted.report_id, report));
  SHIFTMAP_RETURN_IF_ERROR(InsertSightings(database, area_id, inserted.report_id, report));
  return inserted;
}

Status InsertMappedReports(Database& database,
                           std::int64_t area_id,
                           std::int64_t version_id,
                           const RunRecord& run) {
  std::optional<Stamp> first_visit;
  for (const VisitEvidence& evidence : run.evidence) Widen(evidence.begin, &first_visit);
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(
          "INSERT INTO mapped_report (report_id, version_id) SELECT report_id, ?1 "
          "FROM shift_report WHERE identity = ?2 OR (run_hash = ?3 AND ?3 <> '') UNION "
          "SELECT report_id, ?1 FROM shift_report WHERE report_id IN "
          "(SELECT report_id FROM visit_evidence WHERE area_id = ?4 AND begin_ns BETWEEN ?5 AND "
          "?6) "
          "AND vehicle = ?7 AND begin_ns = ?5 AND ?5 >= ?8 AND ?9 <= end_ns "
          "AND run_hash <> '' AND (?10 OR identity = run_hash) ON CONFLICT DO NOTHING"));
  row.Bind(version_id,
           run.identity(),
           run.sha256,
           area_id,
           ToNanoseconds(run.begin),
           ToNanoseconds(run.end),
           run.vehicle,
           ToNanoseconds(kFirstPlausibleStamp),
           NanosecondsOf(first_visit),
           run.uuid.empty() ? 1 : 0);
  return row.Execute();
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

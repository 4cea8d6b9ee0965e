// SPDX-License-Identifier: Apache-2.0
//
// The writing half of the ledger: checking and inserting one shift report.
#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "mapstore/store/blob.h"
#include "mapstore/store/ledger_rows.h"

namespace shiftmap {
namespace {

std::string LowerCase(std::string text) {
  for (char& c : text) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return text;
}

Status InsertEvidence(Database& database,
                      std::int64_t area_id,
                      std::int64_t report_id,
                      const ShiftReport& report) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("INSERT INTO visit_evidence (area_id, signature, begin_ns, end_ns, "
                       "report_id, observation_count, log_likelihoods) "
                       "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)"));
  for (const VisitEvidence& evidence : report.evidence) {
    const std::string log_likelihoods = PackLogLikelihoods(evidence.modes);
    row.Bind(area_id,
             evidence.signature.text(),
             ToNanoseconds(evidence.begin),
             ToNanoseconds(evidence.end),
             report_id,
             evidence.observations,
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

Status CheckEvidence(const ShiftReport& report, const std::string& owner) {
  std::set<std::tuple<std::string, Stamp, Stamp>> visits;
  for (const VisitEvidence& evidence : report.evidence) {
    const std::string& signature = evidence.signature.text();
    if (evidence.end < evidence.begin) {
      return InvalidArgument("{}: evidence of '{}' ends before it begins", owner, signature);
    }
    if (!CheckLogLikelihoods(evidence.modes)) {
      return InvalidArgument(
          "{}: evidence of '{}': expected finite log-likelihoods by ascending mode, absent first",
          owner,
          signature);
    }
    if (!visits.emplace(signature, evidence.begin, evidence.end).second) {
      return InvalidArgument("{}: two visits of '{}' at the same time", owner, signature);
    }
  }
  return OkStatus();
}

}  // namespace

Status CheckReport(const ShiftReport& report) {
  if (report.uuid.empty()) return InvalidArgument("shift report has no uuid");
  const std::string owner = fmt::format("shift report {}", report.uuid);
  if (report.end < report.begin) return InvalidArgument("{}: ends before it begins", owner);
  for (const Decision& decision : report.decisions) {
    if (!std::isfinite(decision.log_odds)) {
      return InvalidArgument(
          "{}: decision on '{}': log odds are not finite", owner, decision.signature.text());
    }
  }
  for (const UnmappedSighting& sighting : report.sightings) {
    if (!sighting.p_map_landmark.allFinite() || !sighting.cov_p_map_landmark.allFinite()) {
      return InvalidArgument(
          "{}: sighting of '{}' is not finite", owner, sighting.signature.text());
    }
  }
  return CheckEvidence(report, owner);
}

StatusOr<bool> HasReport(Database& database, const std::string& uuid) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query,
                            database.Prepare("SELECT 1 FROM shift_report WHERE uuid = ?1"));
  const std::string key = LowerCase(uuid);
  query.Bind(key);
  return query.Step();
}

Status InsertReport(Database& database,
                    std::int64_t area_id,
                    std::int64_t version_id,
                    const ShiftReport& report) {
  const std::string uuid = LowerCase(report.uuid);
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("INSERT INTO shift_report (uuid, version_id, vehicle, run_hash, software, "
                       "begin_ns, end_ns, received_ns) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)"));
  row.Bind(uuid,
           version_id,
           report.vehicle,
           report.run_hash,
           report.software,
           ToNanoseconds(report.begin),
           ToNanoseconds(report.end),
           NowNanoseconds());
  SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  const std::int64_t report_id = database.LastInsertRowId();
  SHIFTMAP_RETURN_IF_ERROR(InsertEvidence(database, area_id, report_id, report));
  SHIFTMAP_RETURN_IF_ERROR(InsertDecisions(database, report_id, report));
  return InsertSightings(database, area_id, report_id, report);
}

}  // namespace shiftmap

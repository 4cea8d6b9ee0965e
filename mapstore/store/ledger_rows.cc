// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/ledger_rows.h"

#include <limits>
#include <unordered_map>
#include <utility>

#include "mapstore/store/blob.h"

namespace shiftmap {
namespace {

struct CountedReport {
  std::string uuid;
  Stamp after;  // Visits of it that begin at or before this time do not count.
};

using CountedReports = std::unordered_map<std::int64_t, CountedReport>;

StatusOr<CountedReports> ReadCountedReports(Database& database,
                                            const std::vector<VersionRow>& lineage) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT report_id, uuid FROM shift_report WHERE version_id = ?1"));
  CountedReports reports;
  for (const VersionRow& version : lineage) {
    const bool own = version.version_id == lineage.front().version_id;
    const Stamp after = own ? Stamp::min() : lineage.front().stamp;
    query.Bind(version.version_id);
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
      if (!row) break;
      reports.emplace(query.Int64(0), CountedReport{query.Text(1), after});
    }
  }
  return reports;
}

// Columns: signature, begin, end, observation count, log-likelihoods.
StatusOr<VisitEvidence> ReadEvidence(const Statement& row, const Database& database) {
  VisitEvidence evidence;
  evidence.signature = Signature(row.Text(0));
  evidence.begin = StampFromNanoseconds(row.Int64(1));
  evidence.end = StampFromNanoseconds(row.Int64(2));
  evidence.observations = row.Int64(3);
  std::optional<std::vector<VisitEvidence::ModeLogLikelihood>> modes =
      UnpackLogLikelihoods(row.Blob(4));
  if (!modes) {
    return DataLoss("{}: evidence of '{}' at {:.6f} s is damaged",
                    database.name(),
                    evidence.signature.text(),
                    ToSecondsSinceEpoch(evidence.begin));
  }
  evidence.modes = *std::move(modes);
  return evidence;
}

}  // namespace

Status ForEachLandmark(
    Database& database,
    std::int64_t area_id,
    const std::vector<VersionRow>& lineage,
    std::optional<Stamp> at,
    const std::function<void(const Signature&, std::vector<EvidenceRow>)>& consume) {
  SHIFTMAP_ASSIGN_OR_RETURN(const CountedReports reports, ReadCountedReports(database, lineage));
  if (reports.empty()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT signature, begin_ns, end_ns, observation_count, log_likelihoods, "
                       "report_id FROM visit_evidence WHERE area_id = ?1 AND begin_ns <= ?2 "
                       "ORDER BY signature, begin_ns, end_ns"));
  query.Bind(area_id, at ? ToNanoseconds(*at) : std::numeric_limits<std::int64_t>::max());
  std::vector<EvidenceRow> landmark;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) break;
    const auto report = reports.find(query.Int64(5));
    if (report == reports.end()) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(VisitEvidence evidence, ReadEvidence(query, database));
    if (evidence.begin <= report->second.after) continue;
    if (!landmark.empty() && landmark.front().evidence.signature != evidence.signature) {
      const Signature signature = landmark.front().evidence.signature;
      consume(signature, std::exchange(landmark, {}));
    }
    landmark.push_back({report->second.uuid, std::move(evidence)});
  }
  if (!landmark.empty()) {
    const Signature signature = landmark.front().evidence.signature;
    consume(signature, std::move(landmark));
  }
  return OkStatus();
}

StatusOr<int> CountUnknownModes(Database& database,
                                std::optional<std::int64_t> version_id,
                                const ShiftReport& report) {
  if (!version_id) return static_cast<int>(report.evidence.size());
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT count(*) FROM landmark_group JOIN mode "
                       "USING (version_id, group_index) WHERE version_id = ?1 AND signature = ?2 "
                       "AND number = ?3"));
  int rows = 0;
  for (const VisitEvidence& evidence : report.evidence) {
    bool known = true;
    for (const VisitEvidence::ModeLogLikelihood& mode : evidence.modes) {
      if (mode.mode == kAbsent) continue;
      query.Bind(*version_id, evidence.signature.text(), mode.mode.value());
      SHIFTMAP_RETURN_IF_ERROR(query.Step().status());
      known = known && query.Int64(0) == 1;
    }
    if (!known) ++rows;
  }
  return rows;
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

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/landmark_rows.h"

#include <algorithm>
#include <optional>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "mapstore/store/blob.h"

namespace shiftmap {
namespace {

constexpr const char* kVisits =
    "SELECT e.begin_ns, e.end_ns, e.report_id, 0, e.version_id, v.number, e.observation_count, "
    "e.log_likelihoods, r.vehicle, r.identity, r.uuid, r.received_ns, "
    "coalesce((SELECT name FROM run WHERE run.identity = r.identity ORDER BY run_id LIMIT 1), '') "
    "FROM visit_evidence e JOIN shift_report r USING (report_id) "
    "JOIN version v ON v.version_id = e.version_id "
    "WHERE e.area_id = ?1 AND e.signature = ?2 UNION ALL "
    "SELECT e.begin_ns, e.end_ns, 0, e.run_id, e.version_id, v.number, e.observation_count, "
    "e.log_likelihoods, r.vehicle, r.identity, '', v.created_ns, r.name "
    "FROM mapped_evidence e JOIN run r USING (run_id) "
    "JOIN version v ON v.version_id = e.version_id "
    "WHERE e.area_id = ?1 AND e.signature = ?2";

constexpr const char* kDecisions =
    "SELECT d.report_id, d.mode, d.stamp_ns, d.log_odds FROM decision d "
    "WHERE d.report_id = ?1 AND d.signature = ?2 AND d.stamp_ns BETWEEN ?3 AND ?4 "
    "ORDER BY d.decision_index DESC LIMIT 1";

// Recursion goes to smaller numbers, so that a damaged file ends it too.
constexpr const char* kVersions =
    "WITH RECURSIVE line (version_id, number, parent) AS (SELECT version_id, number, "
    "parent_version_id FROM version WHERE version_id = ?3 UNION SELECT p.version_id, p.number, "
    "p.parent_version_id FROM line JOIN version p ON p.version_id = line.parent "
    "WHERE p.number < line.number) "
    "SELECT v.version_id, v.number, p.number, v.stamp_ns, v.created_ns, "
    "EXISTS (SELECT 1 FROM line WHERE line.version_id = v.version_id), "
    "g.group_index, g.leave_rate_per_s FROM version v "
    "LEFT JOIN version p ON p.version_id = v.parent_version_id "
    "LEFT JOIN landmark_group g ON g.version_id = v.version_id AND g.signature = ?2 "
    "WHERE v.area_id = ?1 AND v.content_stored ORDER BY v.number";

Status AddDecisions(Database& database,
                    const Signature& signature,
                    std::vector<LandmarkVisitRow>* rows) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare(kDecisions));
  for (LandmarkVisitRow& row : *rows) {
    if (row.report_id == 0) continue;
    const VisitEvidence& evidence = row.visit.evidence;
    query.Bind(row.report_id,
               signature.text(),
               ToNanoseconds(evidence.begin),
               ToNanoseconds(evidence.end));
    SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
    if (!found) continue;
    row.visit.decision = Decision{signature,
                                  ModeNumber(query.Int64(1)),
                                  StampFromNanoseconds(query.Int64(2)),
                                  query.Double(3)};
  }
  return OkStatus();
}

Status AddModes(Statement* modes,
                Statement* merged,
                std::int64_t version_id,
                std::int64_t group_index,
                LandmarkInVersion* landmark) {
  modes->Bind(version_id, group_index);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, modes->Step());
    if (!row) break;
    Mode mode;
    mode.number = ModeNumber(modes->Int64(0));
    mode.p_map_landmark = {modes->Double(1), modes->Double(2)};
    const double cov_xy = modes->Double(4);
    mode.cov_p_map_landmark << modes->Double(3), cov_xy, cov_xy, modes->Double(5);
    mode.last_seen = StampFromNanoseconds(modes->Int64(6));
    landmark->modes.push_back(mode);
  }
  merged->Bind(version_id, group_index);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, merged->Step());
    if (!row) return OkStatus();
    landmark->merged.push_back({ModeNumber(merged->Int64(0)), ModeNumber(merged->Int64(1))});
  }
}

}  // namespace

StatusOr<std::vector<LandmarkVisitRow>> ReadLandmarkVisits(Database& database,
                                                           std::int64_t area_id,
                                                           const Signature& signature) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare(kVisits));
  query.Bind(area_id, signature.text());
  std::vector<LandmarkVisitRow> rows;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
    if (!found) break;
    LandmarkVisitRow row;
    row.report_id = query.Int64(2);
    row.run_id = query.Int64(3);
    row.version_id = query.Int64(4);
    LandmarkVisit& visit = row.visit;
    visit.evidence.signature = signature;
    visit.evidence.begin = StampFromNanoseconds(query.Int64(0));
    visit.evidence.end = StampFromNanoseconds(query.Int64(1));
    visit.evidence.observations = query.Int64(6);
    if (!UnpackLogLikelihoods(query.Blob(7), &visit.evidence.modes)) {
      return DataLoss("{}: evidence of '{}' at {:.6f} s is damaged",
                      database.name(),
                      signature.text(),
                      ToSecondsSinceEpoch(visit.evidence.begin));
    }
    visit.version = VersionNumber(query.Int64(5));
    visit.vehicle = query.Text(8);
    visit.run = query.Text(9);
    visit.report = query.Text(10);
    visit.arrived = StampFromNanoseconds(query.Int64(11));
    visit.run_name = query.Text(12);
    rows.push_back(std::move(row));
  }
  std::sort(rows.begin(), rows.end(), [](const LandmarkVisitRow& a, const LandmarkVisitRow& b) {
    const auto key = [](const LandmarkVisit& visit) {
      return std::tie(visit.evidence.begin,
                      visit.evidence.end,
                      visit.vehicle,
                      visit.run,
                      visit.report,
                      visit.version);
    };
    return key(a.visit) < key(b.visit);
  });
  SHIFTMAP_RETURN_IF_ERROR(AddDecisions(database, signature, &rows));
  return rows;
}

StatusOr<std::vector<LandmarkInVersion>> ReadLandmarkVersions(Database& database,
                                                              std::int64_t area_id,
                                                              const VersionRow& version,
                                                              const Signature& signature) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare(kVersions));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement modes,
      database.Prepare("SELECT number, x_m, y_m, cov_xx_m2, cov_xy_m2, cov_yy_m2, last_seen_ns "
                       "FROM mode WHERE version_id = ?1 AND group_index = ?2 ORDER BY number"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement merged,
      database.Prepare("SELECT number, into_number FROM merged_mode "
                       "WHERE version_id = ?1 AND group_index = ?2 ORDER BY number"));
  query.Bind(area_id, signature.text(), version.version_id);
  std::vector<LandmarkInVersion> versions;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return versions;
    LandmarkInVersion landmark;
    landmark.version = VersionNumber(query.Int64(1));
    if (!query.IsNull(2)) landmark.parent = VersionNumber(query.Int64(2));
    landmark.stamp = StampFromNanoseconds(query.Int64(3));
    landmark.created = StampFromNanoseconds(query.Int64(4));
    landmark.in_line = query.Int64(5) != 0;
    landmark.known = !query.IsNull(6);
    if (landmark.known) {
      landmark.leave_rate_per_s = query.Double(7);
      SHIFTMAP_RETURN_IF_ERROR(
          AddModes(&modes, &merged, query.Int64(0), query.Int64(6), &landmark));
    }
    versions.push_back(std::move(landmark));
  }
}

}  // namespace shiftmap

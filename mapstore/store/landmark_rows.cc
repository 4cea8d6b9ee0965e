// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/landmark_rows.h"

#include <algorithm>
#include <string_view>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "mapstore/store/blob.h"

namespace shiftmap {
namespace {

// ?2: a signature, also by the names that renames gave, or empty for all; ?3: the newest so many,
// or -1.
constexpr const char* kVisits =
    "WITH RECURSIVE names (name) AS (SELECT ?2 UNION "
    "SELECT m.new_name FROM map_edit m JOIN names ON m.signature = names.name "
    "WHERE m.area_id = ?1 AND m.kind = 'rename' UNION "
    "SELECT m.signature FROM map_edit m JOIN names ON m.new_name = names.name "
    "WHERE m.area_id = ?1 AND m.kind = 'rename') "
    "SELECT e.begin_ns, e.end_ns, e.report_id, 0, e.version_id, v.number, e.observation_count, "
    "e.log_likelihoods, r.vehicle, r.identity, r.uuid, r.received_ns, "
    "coalesce((SELECT name FROM run WHERE run.identity = r.identity ORDER BY run_id LIMIT 1), ''), "
    "e.signature "
    "FROM visit_evidence e JOIN shift_report r USING (report_id) "
    "JOIN version v ON v.version_id = e.version_id "
    "WHERE e.area_id = ?1 AND (?2 = '' OR e.signature IN names) UNION ALL "
    "SELECT e.begin_ns, e.end_ns, 0, e.run_id, e.version_id, v.number, e.observation_count, "
    "e.log_likelihoods, r.vehicle, r.identity, '', v.created_ns, r.name, e.signature "
    "FROM mapped_evidence e JOIN run r USING (run_id) "
    "JOIN version v ON v.version_id = e.version_id "
    "WHERE e.area_id = ?1 AND (?2 = '' OR e.signature IN names) ORDER BY 1 DESC LIMIT ?3";

constexpr const char* kDecisions =
    "SELECT d.signature, d.mode, d.stamp_ns, d.log_odds FROM decision d "
    "WHERE d.report_id = ?1 AND (?2 = '' OR d.signature = ?2) ORDER BY d.decision_index";

// Recursion goes to smaller numbers, so that a damaged file ends it too.
constexpr const char* kVersions =
    "WITH RECURSIVE line (version_id, number, parent) AS (SELECT version_id, number, "
    "parent_version_id FROM version WHERE version_id = ?2 UNION SELECT p.version_id, p.number, "
    "p.parent_version_id FROM line JOIN version p ON p.version_id = line.parent "
    "WHERE p.number < line.number) "
    "SELECT v.version_id, v.number, p.number, v.stamp_ns, v.created_ns, "
    "EXISTS (SELECT 1 FROM line WHERE line.version_id = v.version_id) FROM version v "
    "LEFT JOIN version p ON p.version_id = v.parent_version_id "
    "WHERE v.area_id = ?1 AND v.content_stored ORDER BY v.number";

Status AddDecisions(Database& database, std::vector<LandmarkVisitRow>* rows) {
  // One name is asked for; of several all decisions are read.
  const bool one = std::all_of(rows->begin(), rows->end(), [&](const LandmarkVisitRow& row) {
    return row.visit.evidence.signature == rows->front().visit.evidence.signature;
  });
  const std::string signature =
      one && !rows->empty() ? rows->front().visit.evidence.signature.text() : "";
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare(kDecisions));
  std::unordered_map<std::int64_t, std::vector<Decision>> decisions;
  for (LandmarkVisitRow& row : *rows) {
    if (row.report_id == 0) continue;
    const auto [of_report, is_new] = decisions.try_emplace(row.report_id);
    if (is_new) query.Bind(row.report_id, signature);
    while (is_new) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
      if (!found) break;
      of_report->second.push_back({Signature(query.Text(0)),
                                   ModeNumber(query.Int64(1)),
                                   StampFromNanoseconds(query.Int64(2)),
                                   query.Double(3)});
    }
    const VisitEvidence& evidence = row.visit.evidence;
    for (const Decision& decision : of_report->second) {
      const bool inside = evidence.begin <= decision.stamp && decision.stamp <= evidence.end;
      if (inside && decision.signature == evidence.signature) row.visit.decision = decision;
    }
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

StatusOr<std::vector<LandmarkVisitRow>> ReadVisits(Database& database,
                                                   std::int64_t area_id,
                                                   const std::string& signature,
                                                   std::int64_t max_visits) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare(kVisits));
  query.Bind(area_id, signature, max_visits);
  std::vector<LandmarkVisitRow> rows;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
    if (!found) break;
    LandmarkVisitRow row;
    row.report_id = query.Int64(2);
    row.run_id = query.Int64(3);
    row.version_id = query.Int64(4);
    LandmarkVisit& visit = row.visit;
    visit.evidence.signature = Signature(query.Text(13));
    visit.evidence.begin = StampFromNanoseconds(query.Int64(0));
    visit.evidence.end = StampFromNanoseconds(query.Int64(1));
    visit.evidence.observations = query.Int64(6);
    if (!UnpackLogLikelihoods(query.Blob(7), &visit.evidence.modes)) {
      return DataLoss("{}: evidence of '{}' at {:.6f} s is damaged",
                      database.name(),
                      visit.evidence.signature.text(),
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
                      visit.version,
                      visit.evidence.signature);
    };
    return key(a.visit) < key(b.visit);
  });
  SHIFTMAP_RETURN_IF_ERROR(AddDecisions(database, &rows));
  return rows;
}

}  // namespace

StatusOr<std::vector<LandmarkVisitRow>> ReadLandmarkVisits(Database& database,
                                                           std::int64_t area_id,
                                                           const Signature& signature,
                                                           LedgerView* view) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<LandmarkVisitRow> rows,
                            ReadVisits(database, area_id, signature.text(), -1));
  std::vector<LandmarkVisitRow> own;
  for (LandmarkVisitRow& row : rows) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view name,
                              view->NameOf(row.visit.evidence.signature.text(), row.version_id));
    if (name == signature.text()) own.push_back(std::move(row));
  }
  return own;
}

StatusOr<std::vector<LandmarkVisitRow>> ReadNewestVisits(Database& database,
                                                         std::int64_t area_id,
                                                         std::int64_t max_visits) {
  return ReadVisits(database, area_id, "", max_visits);
}

StatusOr<std::vector<LandmarkInVersion>> ReadLandmarkVersions(Database& database,
                                                              std::int64_t area_id,
                                                              const VersionRow& version,
                                                              const Signature& signature,
                                                              LedgerView* view) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare(kVersions));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement group,
      database.Prepare("SELECT group_index, leave_rate_per_s FROM landmark_group "
                       "WHERE version_id = ?1 AND signature = ?2"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement modes,
      database.Prepare("SELECT number, x_m, y_m, cov_xx_m2, cov_xy_m2, cov_yy_m2, last_seen_ns "
                       "FROM mode WHERE version_id = ?1 AND group_index = ?2 ORDER BY number"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement merged,
      database.Prepare("SELECT number, into_number FROM merged_mode "
                       "WHERE version_id = ?1 AND group_index = ?2 ORDER BY number"));
  query.Bind(area_id, version.version_id);
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
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string name,
                              view->NameIn(query.Int64(0), signature.text()));
    group.Bind(query.Int64(0), name);
    SHIFTMAP_ASSIGN_OR_RETURN(landmark.known, group.Step());
    if (landmark.known) {
      landmark.leave_rate_per_s = group.Double(1);
      SHIFTMAP_RETURN_IF_ERROR(
          AddModes(&modes, &merged, query.Int64(0), group.Int64(0), &landmark));
    }
    versions.push_back(std::move(landmark));
  }
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
//
// The part of MapStore that tells of single landmarks.
#include <algorithm>
#include <map>
#include <numeric>
#include <string_view>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "mapstore/map/mode_filter.h"
#include "mapstore/map_store.h"
#include "mapstore/schema/store_file.h"
#include "mapstore/store/landmark_rows.h"
#include "mapstore/store/ledger_filter.h"
#include "mapstore/store/store_state.h"
#include "mapstore/store/track_recorder.h"

namespace shiftmap {
namespace {

// Begin, end, report, run and version: what a filtered visit and its row have in common.
using VisitKey = std::tuple<Stamp, Stamp, std::int64_t, std::int64_t, std::int64_t>;
using VisitProbabilities = std::map<VisitKey, Eigen::VectorXd>;

Stamp After(Stamp at) { return at == Stamp::max() ? at : at + Duration(1); }

// The probabilities at each of the times, for which the filter advances to it.
// @param last  Visits that begin later do not count.
StatusOr<std::vector<Eigen::VectorXd>> Track(const std::vector<Stamp>& times,
                                             std::size_t group,
                                             Stamp last,
                                             LedgerFilter* filter) {
  const Stamp first = filter->before();
  std::vector<std::size_t> order(times.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return times[a] < times[b];
  });
  std::vector<Eigen::VectorXd> track(times.size());
  for (const std::size_t i : order) {
    if (times[i] < first) continue;
    SHIFTMAP_RETURN_IF_ERROR(filter->AdvanceTo(After(std::min(times[i], last))).status());
    track[i] = filter->ProbabilitiesOf(group, times[i]);
  }
  return track;
}

StatusOr<std::optional<LandmarkStatement>> ReadLandmarkStatement(Database& database,
                                                                 const VersionRow& version,
                                                                 const LandmarkGroup& group,
                                                                 LedgerView* view) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow* const statement, view->StatementRow());
  if (statement == nullptr) return std::optional<LandmarkStatement>();
  if (statement->version_id == version.version_id) {
    return std::optional(
        LandmarkStatement{statement->number, statement->stamp, group.probabilities});
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const auto stated,
                            ReadStatementFor(database, statement->version_id, {group}, view));
  if (!stated.front()) return std::optional<LandmarkStatement>();
  return std::optional(LandmarkStatement{statement->number, statement->stamp, *stated.front()});
}

// Why a row does not count, beyond what its probabilities tell.
StatusOr<std::optional<SetAside>> Judge(const LandmarkVisitRow& row,
                                        const std::optional<LandmarkGroup>& group,
                                        const LedgerQuery& query,
                                        LedgerView* view) {
  const LandmarkVisit& visit = row.visit;
  if (query.known && visit.arrived > *query.known) return std::optional(SetAside::kUnknown);
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::optional<SetAside> reason,
      visit.mapped() ? view->JudgeMapped(row.version_id, row.run_id)
                     : view->JudgeReported(row.report_id, row.version_id, visit.evidence.begin));
  if (reason) return reason;
  if (!group) return std::optional(SetAside::kNoLandmark);
  if (!FavoursKnownMode(*group, visit.evidence.modes)) return std::optional(SetAside::kNoMode);
  return std::optional(SetAside::kAhead);
}

// The visits with what the filter made of them. Those after the time asked for are left out.
StatusOr<std::vector<LandmarkVisit>> JudgeVisits(std::vector<LandmarkVisitRow> rows,
                                                 const VisitProbabilities& after,
                                                 const std::optional<LandmarkGroup>& group,
                                                 const LedgerQuery& query,
                                                 LedgerView* view) {
  std::vector<LandmarkVisit> visits;
  for (LandmarkVisitRow& row : rows) {
    VisitEvidence& evidence = row.visit.evidence;
    if (group) {
      SHIFTMAP_RETURN_IF_ERROR(
          view->Split(group->signature.text(), row.report_id, row.run_id, &evidence.modes));
    }
    const auto taken =
        after.find({evidence.begin, evidence.end, row.report_id, row.run_id, row.version_id});
    if (taken != after.end()) {
      row.visit.probabilities = taken->second;
    } else if (query.at && evidence.begin > *query.at) {
      continue;
    } else {
      SHIFTMAP_ASSIGN_OR_RETURN(row.visit.set_aside, Judge(row, group, query, view));
    }
    visits.push_back(std::move(row.visit));
  }
  return visits;
}

std::vector<VisitSpan> SpansOf(const std::vector<LandmarkVisitRow>& rows, Stamp last) {
  std::vector<VisitSpan> spans;
  for (const LandmarkVisitRow& row : rows) {
    const VisitEvidence& evidence = row.visit.evidence;
    if (evidence.begin <= last) spans.push_back({evidence.begin, evidence.end});
  }
  return spans;
}

// Begins as LoadAt does where the ledger is not whole, else before all rows.
Status StartFilter(bool snapshot, const LedgerQuery& query, LedgerFilter* filter) {
  if (!snapshot) return OkStatus();
  const Status started = filter->Start(query.at.value_or(query.latest));
  if (query.at || started.code() != StatusCode::kNotFound) return started;
  return filter->Start(std::nullopt);
}

// What the filter says of the landmark: all of `records` that is probabilities, but for the visits.
Status FilterLandmark(Database& database,
                      const VersionRow& version,
                      const LandmarkGroup& group,
                      std::size_t index,
                      const LedgerQuery& query,
                      LedgerFilter* filter,
                      LandmarkRecords* records) {
  records->group = group;
  SHIFTMAP_ASSIGN_OR_RETURN(records->statement,
                            ReadLandmarkStatement(database, version, group, &filter->view()));
  SHIFTMAP_ASSIGN_OR_RETURN(
      records->track, Track(records->track_times, index, query.at.value_or(query.latest), filter));
  SHIFTMAP_ASSIGN_OR_RETURN(records->stamp, filter->Finish(query));
  records->group->probabilities = filter->ProbabilitiesOf(index, records->stamp);
  return OkStatus();
}

}  // namespace

StatusOr<LandmarkRecords> MapStore::LoadLandmark(const std::string& area,
                                                 const Signature& asked,
                                                 const LandmarkQuery& query) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  if (query.known) {
    SHIFTMAP_RETURN_IF_ERROR(state_->RefuseSnapshot("does not hold what was known before"));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const bool snapshot, IsSnapshot(database));
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version,
                            state_->SelectRow(area, area_row, query.version, query.known));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const MapContent content,
      ReadContent(database, version, state_->VersionName(area, version.number)));
  LedgerFilter filter(database, area_row.area_id, version, content, query.known);
  // A former name stands for the landmark that has another one now.
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view name,
                            filter.view().NameOf(asked.text(), version.version_id));
  const Signature signature{std::string(name)};
  LandmarkRecords records;
  records.signature = signature;
  records.version = version.number;
  SHIFTMAP_ASSIGN_OR_RETURN(
      records.versions,
      ReadLandmarkVersions(database, area_row.area_id, version, signature, &filter.view()));
  SHIFTMAP_ASSIGN_OR_RETURN(
      std::vector<LandmarkVisitRow> rows,
      ReadLandmarkVisits(database, area_row.area_id, signature, &filter.view()));
  const bool known = std::any_of(records.versions.begin(),
                                 records.versions.end(),
                                 [](const LandmarkInVersion& other) { return other.known; });
  if (!known && rows.empty()) {
    return NotFound("{}: no landmark '{}'", state_->AreaName(area), signature.text());
  }
  const auto found =
      std::find_if(content.groups.begin(), content.groups.end(), [&](const LandmarkGroup& group) {
        return group.signature == signature;
      });
  const auto index = static_cast<std::size_t>(found - content.groups.begin());
  const LedgerQuery ledger{
      .at = query.at, .latest = state_->LatestStamp(query.known), .known = query.known};
  records.track_times = query.track;
  if (query.choose_track) {
    const std::vector<Stamp> chosen =
        query.choose_track(SpansOf(rows, query.at.value_or(Stamp::max())), version.stamp);
    records.track_times.insert(records.track_times.end(), chosen.begin(), chosen.end());
  }
  VisitProbabilities after;
  if (found != content.groups.end()) {
    filter.Watch([&](const FilteredVisit& visit) {
      if (visit.group != index) return;
      after[{visit.begin, visit.end, visit.report_id, visit.run_id, visit.version_id}] =
          visit.probabilities;
    });
    SHIFTMAP_RETURN_IF_ERROR(StartFilter(snapshot, ledger, &filter));
    SHIFTMAP_RETURN_IF_ERROR(
        FilterLandmark(database, version, *found, index, ledger, &filter, &records));
  } else {
    records.track.resize(records.track_times.size());
    records.stamp = std::max(version.stamp, query.at.value_or(version.stamp));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      records.visits, JudgeVisits(std::move(rows), after, records.group, ledger, &filter.view()));
  return records;
}

StatusOr<LandmarkTracks> MapStore::LoadTracks(const std::string& area, const TracksQuery& query) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const bool snapshot, IsSnapshot(database));
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  if (query.known) {
    SHIFTMAP_RETURN_IF_ERROR(state_->RefuseSnapshot("does not hold what was known before"));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version,
                            state_->SelectRow(area, area_row, query.version, query.known));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const MapContent content,
      ReadContent(database, version, state_->VersionName(area, version.number)));
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<LandmarkVisitRow> rows,
                            ReadNewestVisits(database, area_row.area_id, query.max_visits));
  LandmarkTracks tracks;
  tracks.version = version.number;
  if (static_cast<std::int64_t>(rows.size()) >= query.max_visits) {
    tracks.since = rows.front().visit.evidence.begin;
  }
  const LedgerQuery ledger{.latest = state_->LatestStamp(query.known), .known = query.known};
  LedgerFilter filter(database, area_row.area_id, version, content, query.known);
  std::vector<VisitProbabilities> after(content.groups.size());
  TrackRecorder recorder(content, tracks.since, rows.size(), filter);
  filter.Watch([&](const FilteredVisit& visit) {
    recorder.Take(visit);
    if (visit.begin < tracks.since) return;
    after[visit.group][{visit.begin, visit.end, visit.report_id, visit.run_id, visit.version_id}] =
        visit.probabilities;
  });
  SHIFTMAP_RETURN_IF_ERROR(StartFilter(snapshot, ledger, &filter));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow* const statement, filter.view().StatementRow());
  if (statement != nullptr && statement->stamp >= filter.before()) {
    SHIFTMAP_RETURN_IF_ERROR(filter.AdvanceTo(After(statement->stamp)).status());
    recorder.TakeAll(statement->stamp);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const Stamp end, filter.Finish(ledger));
  recorder.TakeAll(end);
  tracks.points = recorder.TakePoints();

  std::vector<std::vector<LandmarkVisitRow>> by_group(content.groups.size());
  std::unordered_map<Signature, std::size_t> index;
  for (std::size_t i = 0; i < content.groups.size(); ++i) index[content.groups[i].signature] = i;
  for (LandmarkVisitRow& row : rows) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        const std::string_view name,
        filter.view().NameOf(row.visit.evidence.signature.text(), row.version_id));
    const auto found = index.find(Signature(std::string(name)));
    if (found != index.end()) by_group[found->second].push_back(std::move(row));
  }
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        std::vector<LandmarkVisit> visits,
        JudgeVisits(std::move(by_group[i]), after[i], content.groups[i], ledger, &filter.view()));
    tracks.visits.push_back(std::move(visits));
  }
  return tracks;
}

}  // namespace shiftmap

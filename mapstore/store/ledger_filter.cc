// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/ledger_filter.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "mapstore/map/mode_filter.h"
#include "mapstore/store/blob.h"

namespace shiftmap {
namespace {

// The rows of a stretch of time, in the order in which the chains are filtered.
constexpr const char* kSelectRows =
    "SELECT begin_ns, end_ns, report_id, version_id, signature, log_likelihoods "
    "FROM visit_evidence WHERE area_id = ?1 AND begin_ns >= ?2 AND begin_ns < ?3 "
    "ORDER BY begin_ns, end_ns, report_id, signature";

// The first stamp after `at`; times at the end of what a stamp can hold stay.
Stamp After(Stamp at) { return at == Stamp::max() ? at : at + Duration(1); }

}  // namespace

LedgerFilter::LedgerFilter(Database& database,
                           std::int64_t area_id,
                           const VersionRow& version,
                           const MapContent& content)
    : database_(&database), area_id_(area_id), version_(version), content_(&content) {
  group_index_.reserve(content.groups.size());
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    group_index_.emplace(content.groups[i].signature.text(), static_cast<int>(i));
  }
}

Status LedgerFilter::ReadView() {
  if (view_) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(LedgerView view, LedgerView::Make(*database_, version_));
  view_.emplace(std::move(view));
  return OkStatus();
}

Status LedgerFilter::Start(std::optional<Stamp> at, const std::set<std::string>& without_runs) {
  if (!without_runs.empty()) {
    SHIFTMAP_RETURN_IF_ERROR(ReadView());
    SHIFTMAP_ASSIGN_OR_RETURN(const bool any, view_->SetRunsAside(without_runs));
    // Checkpoints hold what is set aside.
    if (any) return StartFromVersion();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      std::optional<Checkpoint> checkpoint,
      FindCheckpoint(*database_, area_id_, version_.version_id, at, *content_));
  if (!checkpoint) return StartFromVersion();
  SHIFTMAP_RETURN_IF_ERROR(ReadView());
  before_ = checkpoint->before;
  states_ = std::move(checkpoint->states);
  return OkStatus();
}

Status LedgerFilter::StartFromVersion() {
  SHIFTMAP_RETURN_IF_ERROR(ReadView());
  SHIFTMAP_ASSIGN_OR_RETURN(const LedgerView::Bounds bounds, view_->FindBounds());
  before_ = bounds.first_visit;
  states_.groups.assign(content_->groups.size(), std::nullopt);
  states_.newest_end.reset();
  return bounds.first_late_visit ? AddLate(*bounds.first_late_visit) : OkStatus();
}

Status LedgerFilter::AddLate(Stamp first) {
  std::vector<std::optional<ModeState>> late(content_->groups.size());
  SHIFTMAP_ASSIGN_OR_RETURN(Statement rows, database_->Prepare(kSelectRows));
  rows.Bind(area_id_, ToNanoseconds(first), ToNanoseconds(After(version_.stamp)));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) break;
    SHIFTMAP_RETURN_IF_ERROR(AddRow(rows, &late, true));
  }
  for (std::size_t i = 0; i < late.size(); ++i) {
    if (!late[i]) continue;
    const LandmarkGroup& group = content_->groups[i];
    states_.groups[i] = StartModes(group, version_.stamp);
    AddLateVisits(group, *late[i], &*states_.groups[i]);
  }
  return OkStatus();
}

StatusOr<std::int64_t> LedgerFilter::AdvanceTo(Stamp before) {
  std::int64_t count = 0;
  if (before <= before_) return count;
  SHIFTMAP_ASSIGN_OR_RETURN(Statement rows, database_->Prepare(kSelectRows));
  rows.Bind(area_id_, ToNanoseconds(before_), ToNanoseconds(before));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) break;
    ++count;
    SHIFTMAP_RETURN_IF_ERROR(AddRow(rows, &states_.groups, false));
  }
  before_ = before;
  return count;
}

Status LedgerFilter::AddRow(const Statement& row,
                            std::vector<std::optional<ModeState>>* states,
                            bool late) {
  const Stamp begin = StampFromNanoseconds(row.Int64(0));
  const Stamp end = StampFromNanoseconds(row.Int64(1));
  SHIFTMAP_ASSIGN_OR_RETURN(const LedgerView::Verdict verdict,
                            view_->Judge(row.Int64(2), row.Int64(3), begin));
  const auto wanted = late ? LedgerView::Standing::kLate : LedgerView::Standing::kCounts;
  if (verdict.standing != wanted) return OkStatus();
  const int index = GroupOf(row.Blob(4));
  if (index < 0) return OkStatus();
  if (!UnpackLogLikelihoods(row.Blob(5), &modes_)) {
    return DataLoss("{}: evidence of '{}' at {:.6f} s is damaged",
                    database_->name(),
                    row.Text(4),
                    ToSecondsSinceEpoch(begin));
  }
  const LandmarkGroup& group = content_->groups[static_cast<std::size_t>(index)];
  if (!StateLogLikelihoods(group, modes_, &log_likelihoods_)) return OkStatus();
  std::optional<ModeState>& state = (*states)[static_cast<std::size_t>(index)];
  if (!state) {
    state = late ? StationaryStart(group, version_.stamp) : StartModes(group, version_.stamp);
  }
  AddVisit(group, begin, end, log_likelihoods_, &*state);
  if (!late) states_.newest_end = std::max(states_.newest_end.value_or(end), end);
  return OkStatus();
}

int LedgerFilter::GroupOf(std::string_view signature) const {
  const auto found = group_index_.find(signature);
  return found == group_index_.end() ? -1 : found->second;
}

Status ApplyLedger(Database& database,
                   std::int64_t area_id,
                   const VersionRow& version,
                   const LedgerQuery& query,
                   MapContent* content) {
  LedgerFilter filter(database, area_id, version, *content);
  const Stamp last = query.at.value_or(query.latest);
  Status started = filter.Start(last, query.without_runs);
  if (!query.at && started.code() == StatusCode::kNotFound) {
    // The clock is behind a snapshot's begin: its begin is the nearest there is.
    started = filter.Start(std::nullopt, query.without_runs);
  }
  SHIFTMAP_RETURN_IF_ERROR(started);
  SHIFTMAP_RETURN_IF_ERROR(filter.AdvanceTo(After(last)).status());
  const LedgerStates& states = filter.states();
  const Stamp own = content->stamp;
  content->stamp = states.newest_end ? query.at.value_or(*states.newest_end)
                                     : std::max(own, query.at.value_or(own));
  for (std::size_t i = 0; i < content->groups.size(); ++i) {
    LandmarkGroup& group = content->groups[i];
    if (states.groups[i]) {
      group.probabilities = ProbabilitiesAt(group, *states.groups[i], content->stamp);
    } else if (content->stamp > own) {
      group.probabilities = group.chain.Propagate(group.probabilities, content->stamp - own);
    }
  }
  return OkStatus();
}

}  // namespace shiftmap

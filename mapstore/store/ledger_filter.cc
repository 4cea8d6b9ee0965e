// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/ledger_filter.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "mapstore/map/mode_filter.h"
#include "mapstore/store/blob.h"

namespace shiftmap {
namespace {

// The first stamp after `at`; times at the end of what a stamp can hold stay.
Stamp After(Stamp at) { return at == Stamp::max() ? at : at + Duration(1); }

}  // namespace

LedgerFilter::LedgerFilter(Database& database,
                           std::int64_t area_id,
                           const VersionRow& version,
                           const MapContent& content,
                           std::optional<Stamp> known)
    : database_(&database),
      area_id_(area_id),
      version_(version),
      content_(&content),
      view_(database, version, known) {
  group_index_.reserve(content.groups.size());
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    group_index_.emplace(content.groups[i].signature.text(), static_cast<int>(i));
  }
  StartFromNothing();
}

void LedgerFilter::StartFromNothing() {
  before_ = Stamp::min();
  statement_taken_ = false;
  states_.groups.assign(content_->groups.size(), std::nullopt);
  states_.newest_end.reset();
  states_.records = {};
}

Status LedgerFilter::Start(std::optional<Stamp> at) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      std::optional<Checkpoint> checkpoint,
      FindCheckpoint(*database_, area_id_, version_.version_id, at, *content_));
  StartFromNothing();
  if (!checkpoint) return OkStatus();
  before_ = checkpoint->before;
  states_ = std::move(checkpoint->states);
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow* const statement, view_.StatementRow());
  statement_taken_ = statement != nullptr && statement->stamp < before_;
  return OkStatus();
}

StatusOr<std::int64_t> LedgerFilter::AdvanceTo(Stamp before) {
  if (before <= before_) return std::int64_t{0};
  return Take(before, before);
}

StatusOr<Stamp> LedgerFilter::Finish(const LedgerQuery& query) {
  const Stamp last = query.at.value_or(query.latest);
  const Stamp own = version_.stamp <= query.latest ? version_.stamp : Stamp::min();
  const Stamp until = std::max(last, own);
  SHIFTMAP_RETURN_IF_ERROR(Take(After(last), After(until)).status());
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow* const statement, view_.StatementRow());
  Stamp end = query.at ? until : std::max(states_.newest_end.value_or(Stamp::min()), own);
  if (!states_.newest_end) end = std::max(end, statement != nullptr ? statement->stamp : own);
  if (statement != nullptr && !statement_taken_) {
    // It is ahead of the clock, and holds all the same.
    SHIFTMAP_RETURN_IF_ERROR(TakeStatement(std::min(statement->stamp, end)));
  }
  return end;
}

StatusOr<std::int64_t> LedgerFilter::Take(Stamp before, Stamp mapped_before) {
  std::int64_t rows = 0;
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow* const statement, view_.StatementRow());
  if (statement != nullptr && !statement_taken_ && statement->stamp < mapped_before) {
    SHIFTMAP_ASSIGN_OR_RETURN(rows, TakeRows(std::min(statement->stamp, before), statement->stamp));
    SHIFTMAP_RETURN_IF_ERROR(TakeStatement(statement->stamp));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t more, TakeRows(before, mapped_before));
  return rows + more;
}

StatusOr<std::int64_t> LedgerFilter::TakeRows(Stamp before, Stamp mapped_before) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      LedgerCursor cursor,
      LedgerCursor::Make(*database_, area_id_, before_, before, mapped_before));
  for (std::int64_t count = 0;; ++count) {
    SHIFTMAP_ASSIGN_OR_RETURN(const LedgerRow* const row, cursor.Next());
    const bool same_time = row != nullptr && held_count_ > 0 && row->begin == held_.front().begin &&
                           row->end == held_.front().end;
    if (!same_time) TakeHeld();
    if (row == nullptr) {
      before_ = std::max(before_, mapped_before);
      return count;
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const bool counts, view_.Counts(*row));
    if (counts) SHIFTMAP_RETURN_IF_ERROR(HoldRow(*row));
  }
}

Status LedgerFilter::HoldRow(const LedgerRow& row) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view name,
                            view_.NameOf(row.signature, row.version_id));
  const int index = GroupOf(name);
  if (index < 0) return OkStatus();
  const LandmarkGroup& group = content_->groups[static_cast<std::size_t>(index)];
  if (!UnpackLogLikelihoods(row.log_likelihoods, &modes_)) {
    return DataLoss("{}: evidence of '{}' at {:.6f} s is damaged",
                    database_->name(),
                    group.signature.text(),
                    ToSecondsSinceEpoch(row.begin));
  }
  SHIFTMAP_RETURN_IF_ERROR(view_.Split(name, row.report_id, row.run_id, &modes_));
  if (held_count_ == held_.size()) held_.emplace_back();
  HeldVisit& visit = held_[held_count_];
  if (!StateLogLikelihoods(group, modes_, &visit.log_likelihoods)) return OkStatus();
  visit.group = static_cast<std::size_t>(index);
  visit.begin = row.begin;
  visit.end = row.end;
  visit.report_id = row.report_id;
  visit.run_id = row.run_id;
  visit.version_id = row.version_id;
  SHIFTMAP_ASSIGN_OR_RETURN(visit.vehicle, view_.VehicleOf(row.report_id, row.run_id));
  ++held_count_;
  return OkStatus();
}

void LedgerFilter::TakeHeld() {
  const auto end = held_.begin() + static_cast<std::ptrdiff_t>(held_count_);
  std::sort(held_.begin(), end, [](const HeldVisit& a, const HeldVisit& b) {
    return std::tie(a.vehicle->name, a.vehicle->source, a.group) <
           std::tie(b.vehicle->name, b.vehicle->source, b.group);
  });
  for (auto at = held_.begin(); at != end; ++at) {
    const HeldVisit& visit = *at;
    const LandmarkGroup& group = content_->groups[visit.group];
    std::optional<ModeState>& state = states_.groups[visit.group];
    if (!state) {
      const bool own = statement_taken_ && version_.states_probabilities();
      state = own ? StartModes(group, version_.stamp) : StationaryStart(group, visit.begin);
    }
    const std::optional<TurnVerdict> verdict = AddVisit(group,
                                                        visit.begin,
                                                        visit.end,
                                                        visit.vehicle->key,
                                                        states_.records,
                                                        visit.log_likelihoods,
                                                        &*state);
    if (verdict) states_.records.Add(*verdict);
    states_.newest_end = std::max(states_.newest_end.value_or(visit.end), visit.end);
    if (watch_) {
      watch_({visit.group,
              visit.begin,
              visit.end,
              visit.report_id,
              visit.run_id,
              visit.version_id,
              state->Probabilities(states_.records)});
    }
  }
  held_count_ = 0;
}

// A group of which no row tells has the version's own probabilities, and needs no state for them.
Status LedgerFilter::TakeStatement(Stamp stamp) {
  statement_taken_ = true;
  const std::vector<LandmarkGroup>& groups = content_->groups;
  if (version_.states_probabilities()) {
    for (std::size_t i = 0; i < groups.size(); ++i) {
      std::optional<ModeState>& state = states_.groups[i];
      if (state) AddStatement(groups[i], groups[i].probabilities, stamp, states_.records, &*state);
    }
    return OkStatus();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      const auto stated,
      ReadStatementFor(*database_, *version_.statement_version_id, groups, &view_));
  for (std::size_t i = 0; i < groups.size(); ++i) {
    if (!stated[i]) continue;
    std::optional<ModeState>& state = states_.groups[i];
    if (!state) state = StationaryStart(groups[i], stamp);
    AddStatement(groups[i], *stated[i], stamp, states_.records, &*state);
  }
  return OkStatus();
}

Eigen::VectorXd LedgerFilter::ProbabilitiesOf(std::size_t index, Stamp at) const {
  const LandmarkGroup& group = content_->groups[index];
  if (const std::optional<ModeState>& state = states_.groups[index]) {
    return ProbabilitiesAt(group, *state, at, states_.records);
  }
  if (at <= content_->stamp) return group.probabilities;
  return group.chain.Propagate(group.probabilities, content_->stamp, at);
}

int LedgerFilter::GroupOf(std::string_view signature) const {
  const auto found = group_index_.find(signature);
  return found == group_index_.end() ? -1 : found->second;
}

StatusOr<VehicleRecords> ApplyLedger(Database& database,
                                     std::int64_t area_id,
                                     const VersionRow& version,
                                     const LedgerQuery& query,
                                     MapContent* content) {
  LedgerFilter filter(database, area_id, version, *content, query.known);
  if (!query.known) {
    Status started = filter.Start(query.at.value_or(query.latest));
    if (!query.at && started.code() == StatusCode::kNotFound) {
      // The clock is behind a snapshot's begin: its begin is the nearest there is.
      started = filter.Start(std::nullopt);
    }
    SHIFTMAP_RETURN_IF_ERROR(started);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, filter.Finish(query));
  for (std::size_t i = 0; i < content->groups.size(); ++i) {
    content->groups[i].probabilities = filter.ProbabilitiesOf(i, stamp);
  }
  content->stamp = stamp;
  return filter.states().records;
}

}  // namespace shiftmap

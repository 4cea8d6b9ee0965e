// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/ledger_view.h"

#include <utility>

#include "mapstore/map/mode_filter.h"
#include "mapstore/store/edit_rows.h"
#include "mapstore/store/report_rows.h"

namespace shiftmap {

StatusOr<std::optional<SetAside>> LedgerView::JudgeReported(std::int64_t report_id,
                                                            std::int64_t version_id,
                                                            Stamp begin) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Place place, PlaceOf(version_id));
  SHIFTMAP_ASSIGN_OR_RETURN(const Whole whole, JudgeWhole(report_id));
  if (whole.reason) return whole.reason;
  if (place.relation == Relation::kOther) return std::optional(SetAside::kOtherLine);
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow* const statement, StatementRow());
  const bool known = place.before_statement && begin <= statement->stamp &&
                     report_id <= statement->ledger_position.value();
  return known ? std::optional(SetAside::kInMap) : std::nullopt;
}

StatusOr<std::optional<SetAside>> LedgerView::JudgeMapped(std::int64_t version_id,
                                                          std::int64_t run_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Place place, PlaceOf(version_id));
  if (place.relation == Relation::kDescendant) return std::optional(SetAside::kLaterVersion);
  if (place.relation == Relation::kOther) return std::optional(SetAside::kOtherLine);
  if (place.stated()) return std::optional(SetAside::kInMap);
  return ExclusionOf(run_id);
}

StatusOr<bool> LedgerView::Maps(std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Place place, PlaceOf(version_id));
  return place.in_line() && !place.stated();
}

StatusOr<bool> LedgerView::CountsMapped(std::int64_t version_id, std::int64_t run_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<SetAside> reason, JudgeMapped(version_id, run_id));
  return !reason;
}

StatusOr<bool> LedgerView::Counts(const LedgerRow& row) {
  if (row.report_id == 0) return CountsMapped(row.version_id, row.run_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<SetAside> reason,
                            JudgeReported(row.report_id, row.version_id, row.begin));
  return !reason;
}

StatusOr<bool> LedgerView::TellsOfPast(std::int64_t report_id,
                                       std::int64_t run_id,
                                       std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Place place, PlaceOf(version_id));
  if (place.relation == Relation::kOther) return false;
  if (report_id == 0) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<SetAside> reason, ExclusionOf(run_id));
    return !reason && place.relation != Relation::kDescendant;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const Whole whole, JudgeWhole(report_id));
  const bool counts = !whole.reason || whole.reason == SetAside::kRunInMap;
  return counts && !whole.mapped_rows;
}

StatusOr<const std::vector<Exclusion>*> LedgerView::Exclusions() {
  if (!exclusions_) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t area_id, AreaId());
    SHIFTMAP_ASSIGN_OR_RETURN(exclusions_, ReadExclusions(*database_, area_id, known_));
  }
  return &*exclusions_;
}

StatusOr<std::int64_t> LedgerView::AreaId() {
  if (area_id_) return *area_id_;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement area, database_->Prepare("SELECT area_id FROM version WHERE version_id = ?1"));
  area.Bind(version_.version_id);
  SHIFTMAP_RETURN_IF_ERROR(area.Step().status());
  area_id_ = area.Int64(0);
  return *area_id_;
}

StatusOr<bool> LedgerView::HasEdits(EditKind kind) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t area_id, AreaId());
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database_->Prepare("SELECT 1 FROM map_edit WHERE area_id = ?1 AND kind = ?2 LIMIT 1"));
  query.Bind(area_id, ::shiftmap::NameOf(kind));
  return query.Step();
}

StatusOr<const LandmarkNames*> LedgerView::NamesOf(std::int64_t version_id) {
  if (!has_renames_) {
    SHIFTMAP_ASSIGN_OR_RETURN(has_renames_, HasEdits(EditKind::kRename));
  }
  if (!*has_renames_) return static_cast<const LandmarkNames*>(nullptr);
  const auto [found, is_new] = names_.try_emplace(version_id);
  if (is_new) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t area_id, AreaId());
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                              ReadHeldEdits(*database_, area_id, version_id));
    found->second = LandmarkNames(held);
  }
  return &found->second;
}

StatusOr<std::string_view> LedgerView::NameOf(std::string_view signature, std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const LandmarkNames* const other, NamesOf(version_id));
  if (other == nullptr) return signature;
  const auto [found, is_new] = named_.try_emplace({version_id, std::string(signature)});
  if (is_new) {
    SHIFTMAP_ASSIGN_OR_RETURN(const LandmarkNames* const own, NamesOf(version_.version_id));
    found->second = own->Name(other->Landmark(Signature(found->first.second))).text();
  }
  return std::string_view(found->second);
}

StatusOr<std::string> LedgerView::NameIn(std::int64_t version_id, const std::string& signature) {
  SHIFTMAP_ASSIGN_OR_RETURN(const LandmarkNames* const other, NamesOf(version_id));
  if (other == nullptr) return signature;
  SHIFTMAP_ASSIGN_OR_RETURN(const LandmarkNames* const own, NamesOf(version_.version_id));
  return other->Name(own->Landmark(Signature(signature))).text();
}

Status LedgerView::ReadSplits() {
  splits_.emplace();
  SHIFTMAP_ASSIGN_OR_RETURN(const bool any, HasEdits(EditKind::kSplit));
  if (!any) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t area_id, AreaId());
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            ReadHeldEdits(*database_, area_id, version_.version_id));
  const LandmarkNames names(held);
  for (const MapEdit& edit : held) {
    if (edit.kind != EditKind::kSplit) continue;
    (*splits_)[names.Name(edit.landmark).text()].push_back(
        {edit.mode, edit.into, edit.first_runs, edit.second_runs});
  }
  SHIFTMAP_ASSIGN_OR_RETURN(numbers_, ModeNumbers::Make(*database_, version_.version_id));
  return OkStatus();
}

StatusOr<std::vector<ModeSplit>> LedgerView::SplitsOf(std::string_view name) {
  if (!splits_) SHIFTMAP_RETURN_IF_ERROR(ReadSplits());
  const auto found = splits_->find(name);
  return found == splits_->end() ? std::vector<ModeSplit>() : found->second;
}

Status LedgerView::Split(std::string_view name,
                         std::int64_t report_id,
                         std::int64_t run_id,
                         std::vector<VisitEvidence::ModeLogLikelihood>* modes) {
  if (!splits_) SHIFTMAP_RETURN_IF_ERROR(ReadSplits());
  const auto found = splits_->find(name);
  if (found == splits_->end()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const LandmarkGroup* const group,
                            numbers_->Find(*database_, Signature(found->first)));
  if (group == nullptr) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const LedgerVehicle* const vehicle, VehicleOf(report_id, run_id));
  for (const ModeSplit& split : found->second) SplitEvidence(*group, split, vehicle->run, modes);
  return OkStatus();
}

StatusOr<std::optional<SetAside>> LedgerView::ExclusionOf(std::int64_t run_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion>* const exclusions, Exclusions());
  if (exclusions->empty()) return std::optional<SetAside>();
  const auto [found, is_new] = excluded_runs_.try_emplace(run_id);
  if (!is_new) return found->second;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement run,
      database_->Prepare("SELECT identity, sha256, vehicle, begin_ns FROM run WHERE run_id = ?1"));
  run.Bind(run_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool there, run.Step());
  if (!there) return found->second;
  const Exclusion* const exclusion = FindExclusion(
      *exclusions, run.Text(0), run.Text(1), run.Text(2), StampFromNanoseconds(run.Int64(3)));
  if (exclusion != nullptr) {
    found->second = exclusion->held ? SetAside::kHeld : SetAside::kExcluded;
  }
  return found->second;
}

StatusOr<const LedgerVehicle*> LedgerView::VehicleOf(std::int64_t report_id, std::int64_t run_id) {
  const bool reported = report_id != 0;
  const auto [found, is_new] =
      reported ? report_vehicles_.try_emplace(report_id) : run_vehicles_.try_emplace(run_id);
  LedgerVehicle& vehicle = found->second;
  if (!is_new) return &vehicle;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database_->Prepare(
          reported ? "SELECT vehicle, uuid, identity FROM shift_report WHERE report_id = ?1"
                   : "SELECT vehicle, sha256, identity FROM run WHERE run_id = ?1"));
  query.Bind(reported ? report_id : run_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool there, query.Step());
  if (there) vehicle = {query.Text(0), VehicleKey(query.Text(0)), query.Text(1), query.Text(2)};
  return &vehicle;
}

StatusOr<LedgerView::Whole> LedgerView::JudgeWhole(std::int64_t report_id) {
  const auto found = reports_.find(report_id);
  if (found != reports_.end()) return found->second;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement report,
      database_->Prepare("SELECT superseded, identity, run_hash, vehicle, begin_ns, received_ns "
                         "FROM shift_report WHERE report_id = ?1"));
  report.Bind(report_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool there, report.Step());
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion>* const exclusions, Exclusions());
  Whole whole;
  if (there && report.Int64(0) != 0) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool superseded, IsSuperseded(report_id));
    if (superseded) whole.reason = SetAside::kSameRun;
  }
  if (there && !exclusions->empty()) {
    const Exclusion* const exclusion = FindExclusion(*exclusions,
                                                     report.Text(1),
                                                     report.Text(2),
                                                     report.Text(3),
                                                     StampFromNanoseconds(report.Int64(4)));
    if (exclusion != nullptr) {
      whole.reason = exclusion->held ? SetAside::kHeld : SetAside::kExcluded;
    }
  }
  if (there && known_ && StampFromNanoseconds(report.Int64(5)) > *known_) {
    whole.reason = SetAside::kUnknown;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement mapped,
      database_->Prepare("SELECT version_id FROM mapped_report WHERE report_id = ?1"));
  mapped.Bind(report_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow* const statement, StatementRow());
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, mapped.Step());
    if (!row) break;
    SHIFTMAP_ASSIGN_OR_RETURN(const Place place, PlaceOf(mapped.Int64(0)));
    if (!place.in_line()) continue;
    whole.mapped_rows = whole.mapped_rows || !place.stated();
    // What a statement knew is in it, whatever else is true of it.
    if (place.stated() && report_id <= statement->ledger_position.value()) continue;
    if (!whole.reason) whole.reason = SetAside::kRunInMap;
  }
  reports_.emplace(report_id, whole);
  return whole;
}

// Of a report that does not come first of its run: whether one that comes before it is of the
// view's line, had come by then, and is not of a copy that is excluded.
StatusOr<bool> LedgerView::IsSuperseded(std::int64_t report_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion>* const exclusions, Exclusions());
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement others,
      database_->Prepare(fmt::format("SELECT o.version_id, o.identity, o.run_hash, o.vehicle, "
                                     "o.begin_ns {} "
                                     "AND {} AND o.received_ns <= ?2",
                                     SameRunSql(),
                                     kComesBeforeSql)));
  others.Bind(report_id, ToNanoseconds(known_.value_or(Stamp::max())));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, others.Step());
    if (!row) return false;
    SHIFTMAP_ASSIGN_OR_RETURN(const Place place, PlaceOf(others.Int64(0)));
    const bool counts = FindExclusion(*exclusions,
                                      others.Text(1),
                                      others.Text(2),
                                      others.Text(3),
                                      StampFromNanoseconds(others.Int64(4))) == nullptr;
    if (place.relation != Relation::kOther && counts) return true;
  }
}

StatusOr<LedgerView::Place> LedgerView::PlaceOf(std::int64_t version_id) {
  const auto found = places_.find(version_id);
  if (found != places_.end()) return found->second;
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow other, GetVersionById(*database_, version_id));
  Place place;
  SHIFTMAP_ASSIGN_OR_RETURN(place.relation, RelationTo(other));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow* const statement, StatementRow());
  if (statement != nullptr) {
    place.at_statement = version_id == statement->version_id;
    place.before_statement =
        place.relation == Relation::kAncestor && other.number < statement->number;
  }
  places_.emplace(version_id, place);
  return place;
}

StatusOr<const VersionRow*> LedgerView::StatementRow() {
  if (version_.states_probabilities()) return &version_;
  if (!version_.statement_version_id) return static_cast<const VersionRow*>(nullptr);
  if (!statement_) {
    SHIFTMAP_ASSIGN_OR_RETURN(statement_,
                              GetVersionById(*database_, *version_.statement_version_id));
  }
  return &*statement_;
}

// Parents have smaller numbers; a damaged file in which they do not must end too.
StatusOr<LedgerView::Relation> LedgerView::RelationTo(const VersionRow& other) {
  if (other.version_id == version_.version_id) return Relation::kSelf;
  const bool older = other.number < version_.number;
  VersionRow at = older ? top_ : other;
  const VersionNumber last = older ? other.number : version_.number;
  while (at.number > last && at.parent_version_id) {
    SHIFTMAP_ASSIGN_OR_RETURN(VersionRow parent, GetVersionById(*database_, *at.parent_version_id));
    if (parent.number >= at.number) {
      return DataLoss(
          "{}: version row {}: its parent is not older", database_->name(), at.version_id);
    }
    at = std::move(parent);
    if (older) ancestors_.insert(at.version_id);
  }
  if (!older) {
    return at.version_id == version_.version_id ? Relation::kDescendant : Relation::kOther;
  }
  top_ = std::move(at);
  return ancestors_.contains(other.version_id) ? Relation::kAncestor : Relation::kOther;
}

StatusOr<std::vector<std::optional<Eigen::VectorXd>>> ReadStatementFor(
    Database& database,
    std::int64_t version_id,
    const std::vector<LandmarkGroup>& groups,
    LedgerView* view) {
  std::vector<std::string> names;
  std::vector<std::vector<ModeSplit>> splits;
  for (const LandmarkGroup& group : groups) {
    SHIFTMAP_ASSIGN_OR_RETURN(std::string name, view->NameIn(version_id, group.signature.text()));
    names.push_back(std::move(name));
    SHIFTMAP_ASSIGN_OR_RETURN(std::vector<ModeSplit> of_group,
                              view->SplitsOf(group.signature.text()));
    splits.push_back(std::move(of_group));
  }
  return ReadStatement(database, version_id, groups, names, splits);
}

}  // namespace shiftmap

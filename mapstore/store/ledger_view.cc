// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/ledger_view.h"

#include <algorithm>

namespace shiftmap {

StatusOr<LedgerView> LedgerView::Make(Database& database, const VersionRow& version) {
  LedgerView view(database, version);
  view.relations_.emplace(version.version_id, Relation::kOwn);
  SHIFTMAP_RETURN_IF_ERROR(view.ReadSetAsideReports());
  return view;
}

Status LedgerView::ReadSetAsideReports() {
  {
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement query,
        database_->Prepare("SELECT report_id FROM shift_report WHERE superseded = 1"));
    query.Bind();
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
      if (!row) break;
      set_aside_.emplace(query.Int64(0), SetAside::kSameRun);
    }
  }
  // What was known when the version was made is in it, whatever else is true of it.
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database_->Prepare("SELECT report_id, version_id FROM mapped_report WHERE report_id > ?1"));
  query.Bind(version_.ledger_position.value());
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return OkStatus();
    const std::int64_t report_id = query.Int64(0);
    const std::int64_t built = query.Int64(1);
    SHIFTMAP_ASSIGN_OR_RETURN(const Relation relation, RelationTo(built));
    if (built == version_.version_id || relation == Relation::kAncestor) {
      set_aside_.emplace(report_id, SetAside::kRunInMap);
    }
  }
}

StatusOr<bool> LedgerView::SetRunsAside(const std::set<std::string>& runs) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query,
                            database_->Prepare("SELECT report_id FROM shift_report "
                                               "WHERE run_hash = ?1 AND run_hash <> ''"));
  bool any = false;
  for (const std::string& run : runs) {
    query.Bind(run);
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
      if (!row) break;
      any = set_aside_.emplace(query.Int64(0), SetAside::kRunInMap).second || any;
    }
  }
  return any;
}

// Reports against the version or a descendant came after it was made.
StatusOr<LedgerView::Bounds> LedgerView::FindBounds() {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database_->Prepare("SELECT report_id, version_id, first_visit_ns FROM shift_report "
                         "INDEXED BY shift_report_position "
                         "WHERE report_id > ?1 AND first_visit_ns IS NOT NULL"));
  query.Bind(version_.ledger_position.value());
  Bounds bounds{version_.stamp, std::nullopt};
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return bounds;
    const Stamp begin = StampFromNanoseconds(query.Int64(2));
    SHIFTMAP_ASSIGN_OR_RETURN(const Verdict verdict, Judge(query.Int64(0), query.Int64(1), begin));
    if (verdict.standing == Standing::kCounts) {
      bounds.first_visit = std::min(bounds.first_visit, begin);
    } else if (verdict.standing == Standing::kLate) {
      bounds.first_late_visit = std::min(bounds.first_late_visit.value_or(begin), begin);
    }
  }
}

StatusOr<LedgerView::Verdict> LedgerView::Judge(std::int64_t report_id,
                                                std::int64_t version_id,
                                                Stamp begin) {
  if (!set_aside_.empty()) {
    const auto found = set_aside_.find(report_id);
    if (found != set_aside_.end()) return Verdict{Standing::kSetAside, found->second};
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const Relation relation, RelationTo(version_id));
  if (relation == Relation::kOther) return Verdict{Standing::kSetAside, SetAside::kOtherLine};
  if (relation == Relation::kOwn || begin > version_.stamp) return Verdict{Standing::kCounts, {}};
  if (report_id > version_.ledger_position.value()) return Verdict{Standing::kLate, {}};
  return Verdict{Standing::kSetAside, SetAside::kInMap};
}

StatusOr<bool> LedgerView::IsOnLine(std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Relation relation, RelationTo(version_id));
  return relation != Relation::kOther;
}

StatusOr<LedgerView::Relation> LedgerView::RelationTo(std::int64_t version_id) {
  const auto found = relations_.find(version_id);
  if (found != relations_.end()) return found->second;
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow other, GetVersionById(*database_, version_id));
  Relation relation = Relation::kOther;
  if (other.number < version_.number) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool above, IsAncestor(other, version_));
    if (above) relation = Relation::kAncestor;
  } else {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool below, IsAncestor(version_, other));
    if (below) relation = Relation::kOwn;
  }
  relations_.emplace(version_id, relation);
  return relation;
}

// Parents have smaller numbers; a damaged file in which they do not must end too.
StatusOr<bool> LedgerView::IsAncestor(const VersionRow& ancestor, VersionRow descendant) {
  while (descendant.number > ancestor.number && descendant.parent_version_id) {
    if (*descendant.parent_version_id == ancestor.version_id) return true;
    SHIFTMAP_ASSIGN_OR_RETURN(VersionRow parent,
                              GetVersionById(*database_, *descendant.parent_version_id));
    if (parent.number >= descendant.number) {
      return DataLoss(
          "{}: version row {}: its parent is not older", database_->name(), descendant.version_id);
    }
    descendant = std::move(parent);
  }
  return false;
}

}  // namespace shiftmap

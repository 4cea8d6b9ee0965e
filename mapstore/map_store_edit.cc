// SPDX-License-Identifier: Apache-2.0
//
// Edits that a person makes in a map, and takes back.
#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/core/inert_text.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/frame_change.h"
#include "mapstore/map_store.h"
#include "mapstore/store/audit_rows.h"
#include "mapstore/store/edit_rows.h"
#include "mapstore/store/edited_content.h"
#include "mapstore/store/evidence_rows.h"
#include "mapstore/store/exclusion_rows.h"
#include "mapstore/store/store_state.h"

namespace shiftmap {
namespace {

std::set<EditId> IdsOf(const std::vector<MapEdit>& edits) {
  std::set<EditId> ids;
  for (const MapEdit& edit : edits) ids.insert(edit.id);
  return ids;
}

// "3: rename 'L07': replaced (surveyor)"
std::string Subject(EditId id,
                    const MapEdit& edit,
                    const std::string& why,
                    const std::string& who) {
  const std::string& about =
      edit.kind == EditKind::kCalibration ? edit.vehicle : edit.signature.text();
  return fmt::format("{}: {} '{}': {} ({})", id.value(), NameOf(edit.kind), about, why, who);
}

// From the first visit that tells of a landmark to the last. [s]
StatusOr<double> EvidenceSeconds(Database& database,
                                 std::int64_t area_id,
                                 const VersionRow& version,
                                 const Signature& name) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> rows,
                            ReadLineEvidence(database, area_id, version, {}));
  std::optional<Stamp> first;
  Stamp last;
  for (const EvidenceRow& row : rows) {
    if (row.evidence.signature != name) continue;
    first = std::min(first.value_or(row.evidence.begin), row.evidence.begin);
    last = std::max(last, row.evidence.end);
  }
  return first ? ToSecondsSinceEpoch(last) - ToSecondsSinceEpoch(*first) : 0.0;
}

// The identities of runs that a person names, each once.
Status FindRuns(Database& database, std::int64_t area_id, std::vector<std::string>* runs) {
  for (std::string& run : *runs) {
    SHIFTMAP_ASSIGN_OR_RETURN(run, FindRun(database, area_id, run));
  }
  std::sort(runs->begin(), runs->end());
  runs->erase(std::unique(runs->begin(), runs->end()), runs->end());
  return OkStatus();
}

// A name is one landmark's for ever: rows go by it.
Status CheckNewName(Database& database,
                    std::int64_t area_id,
                    const MapEdit& rename,
                    const EditedMap& map) {
  const auto taken = [&](const char* by) {
    return InvalidArgument("'{}': {}", InertLine(rename.new_name.text()), by);
  };
  if (map.names().Aliases().contains(rename.new_name)) return taken("is a former name");
  for (const MapEdit& edit : map.held()) {
    if (edit.kind == EditKind::kRetire && map.names().Name(edit.landmark) == rename.new_name) {
      return taken("is a landmark that was retired");
    }
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::int64_t> versions,
                            VersionsNaming(database, area_id, rename.new_name.text()));
  for (const std::int64_t version_id : versions) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                              ReadHeldEdits(database, area_id, version_id));
    if (LandmarkNames(held).Landmark(rename.new_name) != rename.landmark) {
      return taken("the ledger knows another landmark of that name");
    }
  }
  return OkStatus();
}

// How a surveyed position moves its mode; nothing if the map does not have it.
std::optional<EditResult::Move> MoveOf(const EditedMap& map, const MapEdit& position) {
  const LandmarkGroup* const group = map.GroupOf(position);
  const int state = group == nullptr ? -1 : group->StateOf(position.mode);
  if (state < 1) return std::nullopt;
  const Mode& mode = group->modes[static_cast<std::size_t>(state) - 1];
  const Eigen::Vector2d by = position.p_map_landmark - mode.p_map_landmark;
  const Eigen::Matrix2d cov =
      mode.cov_p_map_landmark + position.sd_m * position.sd_m * Eigen::Matrix2d::Identity();
  return EditResult::Move{by.norm(), std::sqrt(SquaredMahalanobis(by, cov))};
}

}  // namespace

StatusOr<VersionRow> MapStore::State::AddEdited(std::int64_t area_id,
                                                const VersionRow& parent,
                                                const EditedMap& map,
                                                const std::string& tool) {
  const MapContent& content = map.content();
  if (const Status valid = ValidateMapContent(content); !valid.ok()) {
    return InvalidArgument("{}: {}", database.name(), Message(valid));
  }
  const bool states = parent.states_probabilities();
  VersionRow version;
  version.parent_version_id = parent.version_id;
  version.statement_version_id = parent.statement_version_id;
  version.content_hash = states ? ContentHash(content) : GeometryHash(content);
  version.stamp = content.stamp;
  version.created = clock();
  version.ledger_position = parent.ledger_position;
  SHIFTMAP_ASSIGN_OR_RETURN(
      version, AddVersion(area_id, content, {tool, "{}", 0, {}}, states, std::move(version)));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::int64_t> base,
                            ReadEditedVersion(database, parent.version_id));
  SHIFTMAP_RETURN_IF_ERROR(
      SetEditedVersion(database, version.version_id, base.value_or(parent.version_id)));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            ReadHeldEdits(database, area_id, parent.version_id));
  const std::set<EditId> before = IdsOf(held);
  const std::set<EditId> after = IdsOf(map.held());
  for (const EditId id : before) {
    if (after.contains(id)) continue;
    SHIFTMAP_RETURN_IF_ERROR(InsertVersionEdit(database, version.version_id, id, false));
  }
  for (const EditId id : after) {
    if (before.contains(id)) continue;
    SHIFTMAP_RETURN_IF_ERROR(InsertVersionEdit(database, version.version_id, id, true));
  }
  return version;
}

StatusOr<EditResult> MapStore::Edit(const std::string& area, MapEdit edit, bool dry_run) {
  Database& database = state_->database;
  const auto refuse = [&](const Status& status) {
    return Annotate(status, "{}", state_->AreaName(area));
  };
  if (const Status valid = ValidateEdit(edit); !valid.ok()) return refuse(valid);
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Change(dry_run));
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  const std::int64_t area_id = area_row.area_id;
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow published, state_->PublishedRow(area, area_row));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::set<EditId> stay,
                            EditsThatStay(database, area_id, published));
  SHIFTMAP_ASSIGN_OR_RETURN(EditedMap map,
                            RecomputeContent(database, area_id, published, stay, false));

  edit.made = state_->clock();
  edit.landmark = map.names().Landmark(edit.signature);
  if (const Status complete = map.Complete(&edit); !complete.ok()) return refuse(complete);
  if (edit.kind == EditKind::kRename) {
    const Status free = CheckNewName(database, area_id, edit, map);
    if (!free.ok()) return refuse(free);
  }
  if (edit.kind == EditKind::kRate) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        edit.evidence_s,
        EvidenceSeconds(database, area_id, published, map.names().Name(edit.landmark)));
  }
  if (edit.kind == EditKind::kSplit) {
    SHIFTMAP_RETURN_IF_ERROR(FindRuns(database, area_id, &edit.first_runs));
    SHIFTMAP_RETURN_IF_ERROR(FindRuns(database, area_id, &edit.second_runs));
    if (const Status valid = ValidateEdit(edit); !valid.ok()) return refuse(valid);
  }
  if (edit.kind == EditKind::kCalibration) {
    SHIFTMAP_ASSIGN_OR_RETURN(edit.kept,
                              FindKept(database, published.version_id, edit.vehicle, edit.since));
  }
  const Status fitted = map.CheckPoints();
  if (edit.kind == EditKind::kControl) {
    if (const Status fit = map.CheckPointsWith(edit); !fit.ok()) return refuse(fit);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const auto kept, ReadKept(database, area_id, edit));
  if (!dry_run) {
    SHIFTMAP_ASSIGN_OR_RETURN(edit.id, InsertEdit(database, area_id, edit));
  }
  EditResult result;
  if (edit.kind == EditKind::kPosition) result.move = MoveOf(map, edit);
  for (const MapEdit& other : map.held()) {
    if (edit.kind == EditKind::kMerge && other.kind == EditKind::kControl &&
        other.landmark == edit.landmark && other.mode == edit.mode) {
      result.released.push_back(other.id);
    }
  }
  if (const Status applied = map.Apply(edit, kept); !applied.ok()) return refuse(applied);
  if (const Status valid = ValidateMapContent(map.content()); !valid.ok()) return refuse(valid);
  const bool moves_points = edit.kind == EditKind::kPosition || edit.kind == EditKind::kMerge;
  if (moves_points && fitted.ok()) {
    if (const Status fit = map.CheckPoints(); !fit.ok()) return refuse(fit);
  }
  result.edit = edit.id;
  if (dry_run) return result;
  SHIFTMAP_RETURN_IF_ERROR(InsertAudit(database,
                                       area_id,
                                       AuditAction::kEdit,
                                       Subject(edit.id, edit, edit.reason, edit.author),
                                       edit.made));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const VersionRow version,
      state_->AddEdited(area_id, published, map, fmt::format("edit {}", edit.id.value())));
  SHIFTMAP_RETURN_IF_ERROR(state_->MovePublished(area_id, version, AuditAction::kPublish));
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  state_->MakeCheckpoints(area, area_id, version);
  result.version = CommitResult{version.number, version.content_hash};
  return result;
}

StatusOr<EditResult> MapStore::UndoEdit(const std::string& area,
                                        EditId id,
                                        EditUndo undo,
                                        bool dry_run) {
  Database& database = state_->database;
  const auto refuse = [&](const Status& status) {
    return Annotate(status, "{}", state_->AreaName(area));
  };
  if (const Status valid = ValidateUndo(undo); !valid.ok()) return refuse(valid);
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Change(dry_run));
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  const std::int64_t area_id = area_row.area_id;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, ReadEdits(database, area_id));
  const auto edit = std::find_if(
      edits.begin(), edits.end(), [&](const MapEdit& other) { return other.id == id; });
  if (edit == edits.end()) return NotFound("{}: no edit {}", state_->AreaName(area), id.value());
  if (edit->undone) {
    return MakeStatus(StatusCode::kAlreadyExists,
                      "{}: edit {}: was taken back already",
                      state_->AreaName(area),
                      id.value());
  }
  undo.when = state_->clock();
  if (!dry_run) {
    SHIFTMAP_RETURN_IF_ERROR(EndEdit(database, id, undo));
    SHIFTMAP_RETURN_IF_ERROR(InsertAudit(database,
                                         area_id,
                                         AuditAction::kUndo,
                                         Subject(id, *edit, undo.reason, undo.author),
                                         undo.when));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow published, state_->PublishedRow(area, area_row));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            ReadHeldEdits(database, area_id, published.version_id));
  EditResult result;
  result.edit = id;
  const bool holds = IdsOf(held).contains(id);
  if (holds) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool possible, CanRemove(database, area_id, published, *edit));
    result.rests_on = !possible;
  }
  std::optional<VersionRow> version;
  if (holds && !result.rests_on) {
    SHIFTMAP_ASSIGN_OR_RETURN(std::set<EditId> wanted, EditsThatStay(database, area_id, published));
    wanted.erase(id);
    const StatusOr<EditedMap> map = RecomputeContent(database, area_id, published, wanted, false);
    const StatusCode code = map.status().code();
    if (code == StatusCode::kNotFound || code == StatusCode::kInvalidArgument) {
      return FailedPrecondition("{}: edit {}: another one needs it: {}",
                                state_->AreaName(area),
                                id.value(),
                                Message(map.status()));
    }
    SHIFTMAP_RETURN_IF_ERROR(map.status());
    if (!dry_run) {
      SHIFTMAP_ASSIGN_OR_RETURN(
          version,
          state_->AddEdited(area_id, published, *map, fmt::format("edit {} undone", id.value())));
      SHIFTMAP_RETURN_IF_ERROR(state_->MovePublished(area_id, *version, AuditAction::kPublish));
    }
  }
  if (dry_run) return result;
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  if (version) {
    state_->MakeCheckpoints(area, area_id, *version);
    result.version = CommitResult{version->number, version->content_hash};
  }
  return result;
}

StatusOr<std::vector<MapEdit>> MapStore::Edits(const std::string& area) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(state_->database, area));
  return ReadEdits(state_->database, area_row.area_id);
}

StatusOr<std::vector<MapEdit>> MapStore::EditsOf(const std::string& area, VersionNumber version) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(state_->database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row,
                            GetVersion(state_->database, area, area_row.area_id, version));
  return ReadHeldEdits(state_->database, area_row.area_id, row.version_id);
}

StatusOr<Se2> MapStore::FrameStep(const std::string& area, VersionNumber version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row,
                            GetVersion(database, area, area_row.area_id, version));
  if (!row.parent_version_id) return Se2();
  SHIFTMAP_ASSIGN_OR_RETURN(const bool moves, ChangesControlPoints(database, row.version_id));
  if (!moves) return Se2();
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow parent,
                            GetVersionById(database, *row.parent_version_id));
  if (!row.content_stored || !parent.content_stored) return Se2();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> from_edits,
                            ReadHeldEdits(database, area_row.area_id, parent.version_id));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> to_edits,
                            ReadHeldEdits(database, area_row.area_id, row.version_id));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const MapContent from,
      ReadContent(database, parent, state_->VersionName(area, parent.number)));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapContent to,
                            ReadContent(database, row, state_->VersionName(area, row.number)));
  const LandmarkNames to_names(to_edits);
  return FitFrame(WithNames(from, LandmarkNames(from_edits), to_names), to);
}

StatusOr<VersionNumber> MapStore::WithEditsInForce(const std::string& area, VersionNumber version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Write());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  const std::int64_t area_id = area_row.area_id;
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row, GetVersion(database, area, area_id, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t root, RootOfLine(database, row.version_id));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, ReadEdits(database, area_id));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            ReadHeldEdits(database, area_id, row.version_id));
  SHIFTMAP_ASSIGN_OR_RETURN(std::set<EditId> wanted, EditsThatStay(database, area_id, row));
  for (const MapEdit& edit : edits) {
    if (edit.undone) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::int64_t> first,
                              FirstVersionWith(database, edit.id));
    if (!first) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t own_root, RootOfLine(database, *first));
    if (own_root == root) wanted.insert(edit.id);
  }
  if (wanted == IdsOf(held)) return version;
  SHIFTMAP_ASSIGN_OR_RETURN(const EditedMap map,
                            RecomputeContent(database, area_id, row, wanted, true));
  if (IdsOf(map.held()) == IdsOf(held)) return version;
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow edited,
                            state_->AddEdited(area_id, row, map, "edits in force"));
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  return edited.number;
}

}  // namespace shiftmap

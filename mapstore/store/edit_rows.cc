// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/edit_rows.h"

#include <map>
#include <string>
#include <utility>

#include "mapstore/sqlite/row_checksum.h"

namespace shiftmap {
namespace {

// Parents have smaller ids; a damaged file in which they do not must end too.
constexpr char kLine[] =
    "WITH RECURSIVE line (version_id, parent, depth) AS ("
    "SELECT version_id, parent_version_id, 0 FROM version WHERE version_id = ?1 UNION ALL "
    "SELECT v.version_id, v.parent_version_id, depth + 1 FROM line "
    "JOIN version v ON v.version_id = line.parent AND v.version_id < line.version_id) ";

StatusOr<MapEdit> ReadEdit(const Statement& row, const Database& database) {
  MapEdit edit;
  edit.id = EditId(row.Int64(0));
  const std::optional<EditKind> kind = EditKindNamed(row.Text(1));
  if (!kind) {
    return DataLoss("{}: edit {}: no kind '{}'", database.name(), edit.id.value(), row.Text(1));
  }
  edit.kind = *kind;
  edit.author = row.Text(2);
  edit.reason = row.Text(3);
  edit.made = StampFromNanoseconds(row.Int64(4));
  edit.signature = Signature(row.Text(5));
  edit.landmark = Signature(row.Text(6));
  edit.mode = ModeNumber(row.Int64(7));
  edit.into = ModeNumber(row.Int64(8));
  edit.new_name = Signature(row.Text(9));
  edit.p_map_landmark = {row.Double(10), row.Double(11)};
  edit.sd_m = row.Double(12);
  edit.rate_per_s = row.Double(13);
  edit.weight = row.Double(14);
  edit.evidence_s = row.Double(15);
  edit.vehicle = row.Text(16);
  edit.since = StampFromNanoseconds(row.Int64(17));
  if (!row.IsNull(18)) edit.kept = VersionNumber(row.Int64(18));
  if (!row.IsNull(19)) {
    edit.undone = EditUndo{row.Text(20), row.Text(21), StampFromNanoseconds(row.Int64(19))};
  }
  if (!row.IsNull(22)) edit.version = VersionNumber(row.Int64(22));
  edit.p_map_second = {row.Double(23), row.Double(24)};
  return edit;
}

// The runs of which splits say where they met the landmark.
Status ReadSplitRuns(Database& database, std::vector<MapEdit>* edits) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT run, second FROM split_run WHERE edit_id = ?1 ORDER BY run"));
  for (MapEdit& edit : *edits) {
    if (edit.kind != EditKind::kSplit) continue;
    query.Bind(edit.id.value());
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
      if (!row) break;
      (query.Int64(1) != 0 ? edit.second_runs : edit.first_runs).push_back(query.Text(0));
    }
  }
  return OkStatus();
}

Status InsertSplitRuns(Database& database,
                       EditId edit,
                       const std::vector<std::string>& runs,
                       bool second) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement row,
                            database.Prepare(InsertRowSql("split_run", "edit_id, run, second")));
  for (const std::string& run : runs) {
    row.Bind(edit.value(), run, second ? 1 : 0);
    SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  }
  return OkStatus();
}

std::string KeyOf(EditId edit) { return fmt::format("edit_id = {}", edit.value()); }

// The first column of all rows.
StatusOr<std::vector<std::int64_t>> ReadIds(Statement* query) {
  std::vector<std::int64_t> ids;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query->Step());
    if (!row) return ids;
    ids.push_back(query->Int64(0));
  }
}

}  // namespace

StatusOr<std::vector<MapEdit>> ReadEdits(Database& database, std::int64_t area_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          "SELECT edit_id, kind, author, reason, made_ns, signature, landmark, mode, into_mode, "
          "new_name, x_m, y_m, sd_m, rate_per_s, weight, evidence_s, vehicle, since_ns, "
          "(SELECT number FROM version WHERE version_id = kept_version_id), undone_ns, undone_by, "
          "undo_reason, (SELECT min(number) FROM version_edit e JOIN version USING (version_id) "
          "WHERE e.edit_id = map_edit.edit_id AND holds <> 0), second_x_m, second_y_m "
          "FROM map_edit WHERE area_id = ?1 ORDER BY edit_id"));
  query.Bind(area_id);
  std::vector<MapEdit> edits;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) break;
    SHIFTMAP_ASSIGN_OR_RETURN(MapEdit edit, ReadEdit(query, database));
    edits.push_back(std::move(edit));
  }
  SHIFTMAP_RETURN_IF_ERROR(ReadSplitRuns(database, &edits));
  return edits;
}

StatusOr<std::vector<MapEdit>> ReadHeldEdits(Database& database,
                                             std::int64_t area_id,
                                             std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<MapEdit> edits, ReadEdits(database, area_id));
  if (edits.empty()) return edits;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(std::string(kLine) +
                       "SELECT edit_id, holds FROM line JOIN version_edit USING (version_id) "
                       "ORDER BY depth"));
  query.Bind(version_id);
  std::map<EditId, bool> holds;  // As the nearest version says.
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) break;
    holds.try_emplace(EditId(query.Int64(0)), query.Int64(1) != 0);
  }
  std::erase_if(edits, [&](const MapEdit& edit) {
    const auto found = holds.find(edit.id);
    return found == holds.end() || !found->second;
  });
  return edits;
}

StatusOr<EditId> InsertEdit(Database& database, std::int64_t area_id, const MapEdit& edit) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(
          "INSERT INTO map_edit (area_id, kind, author, reason, made_ns, signature, landmark, "
          "mode, into_mode, new_name, x_m, y_m, sd_m, rate_per_s, weight, evidence_s, vehicle, "
          "since_ns, second_x_m, second_y_m, kept_version_id, undone_by, undo_reason) "
          "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, "
          "?18, ?19, ?20, "
          "(SELECT version_id FROM version WHERE area_id = ?1 AND number = ?21), '', '')"));
  std::optional<std::int64_t> kept;
  if (edit.kept) kept = edit.kept->value();
  row.Bind(area_id,
           NameOf(edit.kind),
           edit.author,
           edit.reason,
           ToNanoseconds(edit.made),
           edit.signature.text(),
           edit.landmark.text(),
           edit.mode.value(),
           edit.into.value(),
           edit.new_name.text(),
           edit.p_map_landmark.x(),
           edit.p_map_landmark.y(),
           edit.sd_m,
           edit.rate_per_s,
           edit.weight,
           edit.evidence_s,
           edit.vehicle,
           ToNanoseconds(edit.since),
           edit.p_map_second.x(),
           edit.p_map_second.y(),
           kept);
  SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  const EditId id(database.LastInsertRowId());
  SHIFTMAP_RETURN_IF_ERROR(SetChecksums(database, "map_edit", KeyOf(id)));
  SHIFTMAP_RETURN_IF_ERROR(InsertSplitRuns(database, id, edit.first_runs, false));
  SHIFTMAP_RETURN_IF_ERROR(InsertSplitRuns(database, id, edit.second_runs, true));
  return id;
}

Status EndEdit(Database& database, EditId edit, const EditUndo& undo) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("UPDATE map_edit SET undone_ns = ?2, undone_by = ?3, undo_reason = ?4 "
                       "WHERE edit_id = ?1"));
  row.Bind(edit.value(), ToNanoseconds(undo.when), undo.author, undo.reason);
  SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  return SetChecksums(database, "map_edit", KeyOf(edit));
}

Status InsertVersionEdit(Database& database, std::int64_t version_id, EditId edit, bool holds) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row, database.Prepare(InsertRowSql("version_edit", "version_id, edit_id, holds")));
  row.Bind(version_id, edit.value(), holds ? 1 : 0);
  return row.Execute();
}

StatusOr<bool> ChangesControlPoints(Database& database, std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT 1 FROM version_edit JOIN map_edit USING (edit_id) "
                       "WHERE version_id = ?1 AND kind = ?2 LIMIT 1"));
  query.Bind(version_id, NameOf(EditKind::kControl));
  return query.Step();
}

StatusOr<std::optional<std::int64_t>> FirstVersionWith(Database& database, EditId edit) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT version_id FROM version_edit WHERE edit_id = ?1 AND holds <> 0 "
                       "ORDER BY version_id LIMIT 1"));
  query.Bind(edit.value());
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  return found ? std::optional(query.Int64(0)) : std::nullopt;
}

StatusOr<std::vector<EditId>> ReadEditsOfLine(Database& database, std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(std::string(kLine) +
                       "SELECT DISTINCT edit_id FROM line JOIN version_edit USING (version_id) "
                       "WHERE holds <> 0 ORDER BY edit_id"));
  query.Bind(version_id);
  std::vector<EditId> edits;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return edits;
    edits.emplace_back(query.Int64(0));
  }
}

StatusOr<std::vector<std::int64_t>> EditedVersionsOfLine(Database& database,
                                                         std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(std::string(kLine) +
                       "SELECT DISTINCT version_id FROM line JOIN version_edit USING "
                       "(version_id) ORDER BY version_id"));
  query.Bind(version_id);
  return ReadIds(&query);
}

StatusOr<std::int64_t> RootOfLine(Database& database, std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(std::string(kLine) +
                       "SELECT version_id FROM line ORDER BY depth DESC LIMIT 1"));
  query.Bind(version_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  return found ? query.Int64(0) : version_id;
}

StatusOr<std::optional<VersionNumber>> FindKept(Database& database,
                                                std::int64_t version_id,
                                                const std::string& vehicle,
                                                Stamp since) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(std::string(kLine) +
                       "SELECT number FROM line JOIN version USING (version_id) "
                       "JOIN vehicle_calibration c USING (version_id) "
                       "WHERE vehicle = ?2 AND c.stamp_ns < ?3 ORDER BY depth LIMIT 1"));
  query.Bind(version_id, vehicle, ToNanoseconds(since));
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  return found ? std::optional(VersionNumber(query.Int64(0))) : std::nullopt;
}

StatusOr<std::vector<std::int64_t>> VersionsNaming(Database& database,
                                                   std::int64_t area_id,
                                                   const std::string& name) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT version_id FROM visit_evidence WHERE area_id = ?1 "
                       "AND signature = ?2 UNION SELECT version_id FROM mapped_evidence "
                       "WHERE area_id = ?1 AND signature = ?2"));
  query.Bind(area_id, name);
  return ReadIds(&query);
}

StatusOr<std::optional<std::int64_t>> ReadEditedVersion(Database& database,
                                                        std::int64_t version_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT edited_version_id FROM version WHERE version_id = ?1 "
                       "AND edited_version_id < version_id"));
  query.Bind(version_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  return found ? std::optional(query.Int64(0)) : std::nullopt;
}

Status SetEditedVersion(Database& database, std::int64_t version_id, std::int64_t edited_version) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("UPDATE version SET edited_version_id = ?2 WHERE version_id = ?1"));
  row.Bind(version_id, edited_version);
  SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  return SetChecksums(database, "version", fmt::format("version_id = {}", version_id));
}

}  // namespace shiftmap

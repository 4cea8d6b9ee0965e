// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/edited_content.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "mapstore/store/edit_rows.h"
#include "mapstore/store/vehicle_rows.h"

namespace shiftmap {
namespace {

std::string OwnerOf(const Database& database, const VersionRow& version) {
  return fmt::format("{}: version {}", database.name(), version.number.value());
}

// The build or import that a version rests on.
StatusOr<VersionRow> BaseOf(Database& database, const VersionRow& version) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::int64_t> edited,
                            ReadEditedVersion(database, version.version_id));
  if (!edited) return version;
  return GetVersionById(database, *edited);
}

StatusOr<EditedMap> ReadMap(Database& database, std::int64_t area_id, const VersionRow& version) {
  if (!version.content_stored) {
    return FailedPrecondition("{}: its content was compacted away", OwnerOf(database, version));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(MapContent content,
                            ReadContent(database, version, OwnerOf(database, version)));
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<MapEdit> held,
                            ReadHeldEdits(database, area_id, version.version_id));
  return EditedMap(std::move(content), std::move(held));
}

// The version that an edit was made on.
StatusOr<VersionRow> VersionBefore(Database& database, const MapEdit& edit) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::int64_t> first,
                            FirstVersionWith(database, edit.id));
  if (!first) return DataLoss("{}: edit {}: no version", database.name(), edit.id.value());
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version, GetVersionById(database, *first));
  if (!version.parent_version_id) {
    return DataLoss("{}: edit {}: its version has no parent", database.name(), edit.id.value());
  }
  return GetVersionById(database, *version.parent_version_id);
}

StatusOr<EditedMap> MapBefore(Database& database, std::int64_t area_id, const MapEdit& edit) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow parent, VersionBefore(database, edit));
  if (!parent.content_stored) {
    return FailedPrecondition(
        "{}: edit {} cannot be taken out: version {}, which has what it took away, was compacted "
        "away",
        database.name(),
        edit.id.value(),
        parent.number.value());
  }
  return ReadMap(database, area_id, parent);
}

bool Holds(const std::vector<MapEdit>& held, EditId id) {
  return std::any_of(held.begin(), held.end(), [&](const MapEdit& edit) { return edit.id == id; });
}

}  // namespace

StatusOr<EditedMap> RecomputeContent(Database& database,
                                     std::int64_t area_id,
                                     const VersionRow& version,
                                     const std::set<EditId>& wanted,
                                     bool lenient) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow base, BaseOf(database, version));
  SHIFTMAP_ASSIGN_OR_RETURN(EditedMap map, ReadMap(database, area_id, base));
  const std::vector<MapEdit> of_base = map.held();
  const std::vector<MapEdit> newest_first(of_base.rbegin(), of_base.rend());
  for (const MapEdit& edit : newest_first) {
    if (wanted.contains(edit.id) || !map.IsReversible(edit)) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(
        const EditedMap before,
        EditedMap::TakesAway(edit) ? MapBefore(database, area_id, edit) : StatusOr<EditedMap>(map));
    SHIFTMAP_RETURN_IF_ERROR(map.Reverse(edit, before));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, ReadEdits(database, area_id));
  for (const MapEdit& edit : edits) {
    if (!wanted.contains(edit.id) || Holds(of_base, edit.id)) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const auto kept, ReadKept(database, area_id, edit));
    const bool control = edit.kind == EditKind::kControl;
    const Status fits = control ? map.CheckPointsWith(edit) : OkStatus();
    const Status applied = fits.ok() ? map.Apply(edit, kept) : fits;
    if (applied.ok() || lenient) continue;
    return Annotate(applied, "edit {}", edit.id.value());
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EditId> of_line,
                            ReadEditsOfLine(database, version.version_id));
  for (const MapEdit& edit : edits) {
    const bool added = edit.kind == EditKind::kNewMode || edit.kind == EditKind::kSplit;
    const bool gone = added && !wanted.contains(edit.id) &&
                      std::binary_search(of_line.begin(), of_line.end(), edit.id);
    if (gone) map.Reserve(edit);
  }
  return map;
}

StatusOr<std::set<EditId>> EditsThatStay(Database& database,
                                         std::int64_t area_id,
                                         const VersionRow& version) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow base, BaseOf(database, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> of_base,
                            ReadHeldEdits(database, area_id, base.version_id));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            ReadHeldEdits(database, area_id, version.version_id));
  std::set<EditId> stay;
  for (const MapEdit& edit : held) {
    bool stays = !edit.undone;
    if (!stays && Holds(of_base, edit.id) && EditedMap::TakesAway(edit)) {
      SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow before, VersionBefore(database, edit));
      stays = !before.content_stored;
    }
    if (stays) stay.insert(edit.id);
  }
  return stay;
}

StatusOr<bool> CanRemove(Database& database,
                         std::int64_t area_id,
                         const VersionRow& version,
                         const MapEdit& edit) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow base, BaseOf(database, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const EditedMap map, ReadMap(database, area_id, base));
  return !Holds(map.held(), edit.id) || map.IsReversible(edit);
}

StatusOr<std::optional<VehicleCalibration>> ReadKept(Database& database,
                                                     std::int64_t area_id,
                                                     const MapEdit& edit) {
  if (!edit.kept) return std::optional<VehicleCalibration>();
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version,
                            GetVersion(database, "", area_id, *edit.kept));
  std::vector<VehicleCalibration> vehicles;
  SHIFTMAP_RETURN_IF_ERROR(ReadVehicleRows(database, version.version_id, vehicles));
  for (VehicleCalibration& vehicle : vehicles) {
    if (vehicle.vehicle == edit.vehicle) return std::optional(std::move(vehicle));
  }
  return DataLoss("{}: edit {}: version {} does not know vehicle '{}'",
                  database.name(),
                  edit.id.value(),
                  edit.kept->value(),
                  edit.vehicle);
}

}  // namespace shiftmap

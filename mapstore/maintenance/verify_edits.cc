// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <iterator>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "mapstore/core/inert_text.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/maintenance/verify_rows.h"
#include "mapstore/map/map_edit.h"
#include "mapstore/store/edit_rows.h"
#include "mapstore/store/edited_content.h"
#include "mapstore/store/version_rows.h"

namespace shiftmap {
namespace {

Status VerifyRows(Database& database, std::int64_t area_id, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, ReadEdits(database, area_id));
  for (const MapEdit& edit : edits) {
    const std::string key = fmt::format("edit {}", edit.id.value());
    if (const Status valid = ValidateEdit(edit); !valid.ok()) {
      defects->Add("map_edit", key, Message(valid));
    }
    if (edit.undone && !ValidateUndo(*edit.undone).ok()) {
      defects->Add("map_edit", key, "is taken back without author or reason");
    }
    const bool of_vehicle = edit.kind == EditKind::kCalibration;
    if (!of_vehicle && edit.landmark.anonymous()) {
      defects->Add("map_edit", key, "is about no landmark");
    }
    if (!(edit.evidence_s >= 0.0)) defects->Add("map_edit", key, "time of its evidence below 0");
  }
  return OkStatus();
}

Status VerifyLinks(Database& database, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT edit_id, v.number, e.area_id = v.area_id, holds IN (0, 1) "
                       "FROM version_edit JOIN map_edit e USING (edit_id) "
                       "JOIN version v USING (version_id)"));
  rows.Bind();
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return OkStatus();
    const std::string key = fmt::format("edit {}, version {}", rows.Int64(0), rows.Int64(1));
    if (rows.Int64(2) == 0) defects->Add("version_edit", key, "is of another area");
    if (rows.Int64(3) == 0) defects->Add("version_edit", key, "neither holds nor does not");
  }
}

// Whether a version has other control points or merges than the build that it rests on. What these
// give is computed, and may be so otherwise by another release.
StatusOr<bool> IsComputed(Database& database,
                          std::int64_t area_id,
                          const VersionRow& version,
                          const std::vector<MapEdit>& held) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto base, ReadEditedVersion(database, version.version_id));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> of_base,
                            ReadHeldEdits(database, area_id, base.value_or(version.version_id)));
  std::vector<MapEdit> other;
  std::set_symmetric_difference(held.begin(),
                                held.end(),
                                of_base.begin(),
                                of_base.end(),
                                std::back_inserter(other),
                                [](const auto& a, const auto& b) { return a.id < b.id; });
  return std::any_of(other.begin(), other.end(), [](const MapEdit& edit) {
    return edit.kind == EditKind::kControl || edit.kind == EditKind::kMerge;
  });
}

// What of a map is not as its edits give it, but for what another release computes otherwise: the
// landmarks, their modes, or a position by more than the map knows it. Nothing if all is.
std::optional<std::string> FindDifference(const MapContent& map, const MapContent& from_edits) {
  constexpr double kRounding = 1e-3;  // [m]
  const auto number = [](const Mode& mode) { return mode.number; };
  const auto same_modes = [&](const LandmarkGroup& a, const LandmarkGroup& b) {
    return a.signature == b.signature && std::ranges::equal(a.modes, b.modes, {}, number, number);
  };
  if (!std::ranges::equal(map.groups, from_edits.groups, same_modes)) {
    return "its edits give other landmarks or modes";
  }
  for (std::size_t g = 0; g < map.groups.size(); ++g) {
    for (std::size_t i = 0; i < map.groups[g].modes.size(); ++i) {
      const Mode& a = map.groups[g].modes[i];
      const Mode& b = from_edits.groups[g].modes[i];
      const double off = (a.p_map_landmark - b.p_map_landmark).norm();
      if (off <= 3.0 * std::max(LargestSd(a.cov_p_map_landmark), LargestSd(b.cov_p_map_landmark)) +
                     kRounding)
        continue;
      return fmt::format("its edits put mode {} of '{}' {:.3f} m from where it is",
                         a.number.value(),
                         InertLine(map.groups[g].signature.text()),
                         off);
    }
  }
  return std::nullopt;
}

// Makes a version of edits again from the build that it rests on.
Status VerifyEdited(Database& database,
                    std::int64_t area_id,
                    const VersionRow& version,
                    DefectList* defects) {
  const std::string key = fmt::format("version {}", version.number.value());
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            ReadHeldEdits(database, area_id, version.version_id));
  std::set<EditId> wanted;
  for (const MapEdit& edit : held) wanted.insert(edit.id);
  const StatusOr<EditedMap> map = RecomputeContent(database, area_id, version, wanted, true);
  // What it takes may be compacted away.
  if (map.status().code() == StatusCode::kFailedPrecondition) return OkStatus();
  SHIFTMAP_RETURN_IF_ERROR(map.status());
  const std::string hash =
      version.states_probabilities() ? ContentHash(map->content()) : GeometryHash(map->content());
  if (hash == version.content_hash) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const bool computed, IsComputed(database, area_id, version, held));
  if (!computed) {
    defects->Add("version", key, "its edits give another content: " + hash);
    return OkStatus();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const MapContent stored, ReadContent(database, version, key));
  const auto difference = FindDifference(stored, map->content());
  if (difference) defects->Add("version", key, *difference);
  return OkStatus();
}

}  // namespace

Status VerifyEdits(Database& database, DefectList* defects) {
  SHIFTMAP_RETURN_IF_ERROR(VerifyLinks(database, defects));
  std::vector<std::int64_t> areas;
  {
    SHIFTMAP_ASSIGN_OR_RETURN(Statement rows, database.Prepare("SELECT area_id FROM area"));
    rows.Bind();
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
      if (!row) break;
      areas.push_back(rows.Int64(0));
    }
  }
  for (const std::int64_t area_id : areas) {
    SHIFTMAP_RETURN_IF_ERROR(VerifyRows(database, area_id, defects));
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement rows,
        database.Prepare("SELECT version_id, edited_version_id < version_id FROM version "
                         "WHERE area_id = ?1 AND edited_version_id IS NOT NULL "
                         "AND content_stored <> 0 ORDER BY version_id"));
    rows.Bind(area_id);
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
      if (!row) break;
      SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version, GetVersionById(database, rows.Int64(0)));
      if (rows.Int64(1) == 0) {
        defects->Add("version",
                     fmt::format("version {}", version.number.value()),
                     "is an edit of a version that is not older");
        continue;
      }
      SHIFTMAP_RETURN_IF_ERROR(VerifyEdited(database, area_id, version, defects));
    }
  }
  return OkStatus();
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/map_edit.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// All edits of an area, by id. Errors: kDataLoss for a kind that there is not.
StatusOr<std::vector<MapEdit>> ReadEdits(Database& database, std::int64_t area_id);

/// Those with which a version is made, taken back since or not, by id.
StatusOr<std::vector<MapEdit>> ReadHeldEdits(Database& database,
                                             std::int64_t area_id,
                                             std::int64_t version_id);

/// Adds an edit; returns its id.
StatusOr<EditId> InsertEdit(Database& database, std::int64_t area_id, const MapEdit& edit);

Status EndEdit(Database& database, EditId edit, const EditUndo& undo);

/// Notes that a version takes an edit in, or leaves it again.
Status InsertVersionEdit(Database& database, std::int64_t version_id, EditId edit, bool holds);

/// Whether a version takes in a control point or leaves one.
StatusOr<bool> ChangesControlPoints(Database& database, std::int64_t version_id);

/// The first version that was made with an edit; nothing if none was.
StatusOr<std::optional<std::int64_t>> FirstVersionWith(Database& database, EditId edit);

/// Edits that versions of a line take in, by id.
StatusOr<std::vector<EditId>> ReadEditsOfLine(Database& database, std::int64_t version_id);

/// The versions of a line that take edits in or leave them.
StatusOr<std::vector<std::int64_t>> EditedVersionsOfLine(Database& database,
                                                         std::int64_t version_id);

/// The oldest version of a version's line.
StatusOr<std::int64_t> RootOfLine(Database& database, std::int64_t version_id);

/// The newest version of a line that knows a vehicle from before a time only.
StatusOr<std::optional<VersionNumber>> FindKept(Database& database,
                                                std::int64_t version_id,
                                                const std::string& vehicle,
                                                Stamp since);

/// The versions of an area of which the ledger has rows under a name.
StatusOr<std::vector<std::int64_t>> VersionsNaming(Database& database,
                                                   std::int64_t area_id,
                                                   const std::string& name);

/// Which version a version has its content from, with other edits; nothing: it is a build or an
/// import.
StatusOr<std::optional<std::int64_t>> ReadEditedVersion(Database& database,
                                                        std::int64_t version_id);
Status SetEditedVersion(Database& database, std::int64_t version_id, std::int64_t edited_version);

}  // namespace shiftmap

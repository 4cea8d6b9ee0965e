// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Writes the groups, modes, cross covariances, anonymous landmarks and vehicles of a version;
/// stamp and the fleet's calibration are columns of its `version` row.
Status InsertContentRows(Database& database, std::int64_t version_id, const MapContent& content);

/// Reads them back into `content`, whose stamp and calibration stay.
/// @param owner  Starts the messages.
/// Errors: kDataLoss if the rows are not what InsertContentRows writes. That the numbers in them
/// are right is for the content hash to say.
Status ReadContentRows(Database& database,
                       std::int64_t version_id,
                       const std::string& owner,
                       MapContent& content);

}  // namespace shiftmap

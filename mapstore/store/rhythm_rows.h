// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mapstore/map/landmark_group.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Writes the rhythms of a version's chains, in the order of its groups.
Status InsertRhythmRows(Database& database,
                        std::int64_t version_id,
                        const std::vector<LandmarkGroup>& groups);

/// Gives the groups, whose chains have their rates, the rhythms of a version.
/// @param owner  Starts the messages.
/// Errors: kDataLoss.
Status ReadRhythmRows(Database& database,
                      std::int64_t version_id,
                      const std::string& owner,
                      std::vector<LandmarkGroup>& groups);

}  // namespace shiftmap

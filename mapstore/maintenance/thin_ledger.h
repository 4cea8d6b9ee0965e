// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "mapstore/core/stamp.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Deletes rows of the ledger that repeat what the rows before and after them say of a landmark.
///
/// A row is sure if it favours one state by 10 nats over every other one. A stretch is sure rows
/// for one state, with nothing between two of them that says 1 nat or more against it. Of a stretch
/// stay
///
///   the first row, and the first row of another vehicle;
///   the last row, and the last row before it of another vehicle;
///   a row at the end of each gap of 0.05 / λ, the landmark's rate of leaving a mode.
///
/// All rows outside of stretches stay, and all from `before` on. So moves stay, who confirmed them,
/// and what is known after the last row. What is lost:
///
///   within a stretch a probability is up to 0.1 off;
///   rates are up to a twentieth larger, as the landmark may have left and come back unseen;
///   good turns of a vehicle are fewer than they were, and its trust is learned from less;
///   if a run is excluded later, rows of others that said the same do not come back;
///   a version that is not of the line of `version` may miss rows that counted for it alone.
///
/// @param version  Whose view decides which rows count; of others none goes.
/// @param owner    Starts the messages about the version.
/// Returns how many rows went. Cost: one pass over the rows before `before`.
StatusOr<std::int64_t> ThinLedger(Database& database,
                                  std::int64_t area_id,
                                  const VersionRow& version,
                                  Stamp before,
                                  const std::string& owner);

}  // namespace shiftmap

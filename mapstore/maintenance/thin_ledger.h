// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "mapstore/core/stamp.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Sums up rows of the ledger that repeat what the rows before and after them say of a landmark.
///
/// A row is sure if it favours one state by 10 nats over every other one. A stretch is sure rows
/// for one state, with nothing between two of them that says 1 nat or more against it. Of a stretch
/// stay
///
///   the first row, and the first row of another vehicle;
///   the last row, and the last row before it of another vehicle;
///   one row for all the sure ones in between, from the begin of the first one to the end of the
///   last one, with their number and what their gaps tell of rates (LedgerSummary). A gap in which
///   the landmark moves with a probability of 0.05 or more parts two of them.
///
/// All rows outside of stretches stay, and all from `before` on. So moves stay, who confirmed them,
/// and what is known after the last row. A summary has as many steps as give the gaps' sum and sum
/// of squares, which a chain's fit reads to the second order of rate times gap, and no more than
/// take the probability of a move to 0.005 each. What is lost:
///
///   within a stretch a probability is that of hindsight, as a summary holds throughout: a reader
///   of the past sees less doubt than there was; rates are up to 0.5 % larger, as the landmark may
///   have left and come back unseen; hours at which the landmark stayed count alike, for a rhythm;
///   good turns of a vehicle are fewer than they were, and its trust is learned from less;
///   if a run is excluded later, rows of others that said the same do not come back, and what a
///   summary of its first visit stands for goes with it;
///   a version that is not of the line of `version` may miss rows that counted for it alone.
///
/// @param version  Whose view decides which rows count; of others none goes.
/// @param owner    Starts the messages about the version.
/// Returns by how many rows the ledger is shorter. Cost: one pass over the rows before `before`.
StatusOr<std::int64_t> ThinLedger(Database& database,
                                  std::int64_t area_id,
                                  const VersionRow& version,
                                  Stamp before,
                                  const std::string& owner);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map/vehicle_records.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// How far the ledger is filtered for a version.
struct LedgerStates {
  /// Per group of the content; nothing where no evidence changed the group's own probabilities.
  std::vector<std::optional<ModeState>> groups;
  std::optional<Stamp> newest_end;  ///< Of the visits that count.
  VehicleRecords records;           ///< Of the vehicles, up to there.
};

/// A stored LedgerStates.
struct Checkpoint {
  Stamp before;             ///< Visits that began earlier are in it.
  bool rows_stored = true;  ///< False in a snapshot, which does not have the rows before it.
  LedgerStates states;
};

/// The newest checkpoint of a version that holds no visit that begins after `at`.
/// @param content  The version's.
/// Errors: kDataLoss if it is damaged; kNotFound if the file is a snapshot whose ledger begins
/// after `at`.
StatusOr<std::optional<Checkpoint>> FindCheckpoint(Database& database,
                                                   std::int64_t area_id,
                                                   std::int64_t version_id,
                                                   std::optional<Stamp> at,
                                                   const MapContent& content);

Status InsertCheckpoint(Database& database,
                        std::int64_t area_id,
                        std::int64_t version_id,
                        const Checkpoint& checkpoint);

/// Deletes what a visit that begins at `begin` makes wrong: the checkpoints after it, of all
/// versions of an area. Returns how many.
StatusOr<int> DeleteCheckpointsAfter(Database& database, std::int64_t area_id, Stamp begin);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/checkpoint_rows.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/store/blob.h"

namespace shiftmap {
namespace {

void Add(const Eigen::VectorXd& values, BlobWriter* blob) {
  for (const double value : values) blob->Add(value);
}

std::string PackStates(const LedgerStates& states) {
  BlobWriter blob;
  blob.Add(static_cast<std::int64_t>(states.records.broken().size()));
  for (const auto& [vehicle, broken] : states.records.broken()) {
    blob.Add(vehicle);
    blob.Add(broken);
  }
  for (std::size_t i = 0; i < states.groups.size(); ++i) {
    if (!states.groups[i]) continue;
    const ModeState& state = *states.groups[i];
    blob.Add(static_cast<std::int64_t>(i));
    blob.Add(ToNanoseconds(state.stamp));
    blob.Add(std::int64_t{state.started ? 1 : 0});
    blob.Add(std::int64_t{state.turn ? 1 : 0});
    if (!state.turn) {
      Add(state.log_probabilities, &blob);
      continue;
    }
    blob.Add(state.turn->vehicle);
    blob.Add(state.turn->log_bayes_factor);
    Add(state.turn->log_right, &blob);
    Add(state.turn->log_own, &blob);
    Add(state.turn->mistaken, &blob);
  }
  return blob.bytes();
}

// False if the bytes do not go on with so many numbers, or what the function says.
bool TakeNumbers(int states, BlobReader* blob, Eigen::VectorXd* values) {
  if (blob->left() < static_cast<std::size_t>(states)) return false;
  values->resize(states);
  for (double& value : *values) value = blob->Double();
  return true;
}

bool TakeLogDistribution(int states, BlobReader* blob, Eigen::VectorXd* log_probabilities) {
  // The logarithm of a probability may be -inf, but not of all.
  return TakeNumbers(states, blob, log_probabilities) &&
         std::abs(log_probabilities->array().exp().sum() - 1.0) < 1e-6;
}

// False if the bytes do not go on with a turn.
bool TakeTurn(int states, BlobReader* blob, VehicleTurn* turn) {
  if (blob->left() < 2) return false;
  turn->vehicle = blob->Integer();
  turn->log_bayes_factor = blob->Double();
  return !std::isnan(turn->log_bayes_factor) &&
         TakeLogDistribution(states, blob, &turn->log_right) &&
         TakeLogDistribution(states, blob, &turn->log_own) &&
         TakeNumbers(states, blob, &turn->mistaken) && std::abs(turn->mistaken.sum() - 1.0) < 1e-6;
}

// False if the bytes do not begin with records.
bool TakeRecords(BlobReader* blob, VehicleRecords* records) {
  constexpr std::size_t kNumbers = 2;
  if (blob->left() < 1) return false;
  const std::int64_t count = blob->Integer();
  if (count < 0 || static_cast<std::uint64_t>(count) > blob->left() / kNumbers) return false;
  std::optional<std::int64_t> previous;
  for (std::int64_t i = 0; i < count; ++i) {
    const std::int64_t vehicle = blob->Integer();
    const double broken = blob->Double();
    if (previous && vehicle <= *previous) return false;
    if (!(broken > 0.0 && broken < 1.0)) return false;
    previous = vehicle;
    records->Set(vehicle, broken);
  }
  return true;
}

// False if the bytes are no such BLOB for this content.
bool UnpackStates(std::string_view bytes, const MapContent& content, LedgerStates* states) {
  states->groups.assign(content.groups.size(), std::nullopt);
  if (bytes.size() % sizeof(std::int64_t) != 0) return false;
  BlobReader blob(bytes);
  if (!TakeRecords(&blob, &states->records)) return false;
  std::int64_t previous = -1;
  while (blob.left() > 0) {
    if (blob.left() < 3) return false;
    const std::int64_t group = blob.Integer();
    if (group <= previous || group >= static_cast<std::int64_t>(content.groups.size())) {
      return false;
    }
    previous = group;
    ModeState state;
    state.stamp = StampFromNanoseconds(blob.Integer());
    state.started = blob.Integer() != 0;
    const int size = content.groups[static_cast<std::size_t>(group)].chain.states();
    if (blob.left() < 1) return false;
    if (blob.Integer() == 0) {
      if (!TakeLogDistribution(size, &blob, &state.log_probabilities)) return false;
    } else {
      if (!TakeTurn(size, &blob, &state.turn.emplace())) return false;
    }
    states->groups[static_cast<std::size_t>(group)] = std::move(state);
  }
  return true;
}

}  // namespace

StatusOr<std::optional<Checkpoint>> FindCheckpoint(Database& database,
                                                   std::int64_t area_id,
                                                   std::int64_t version_id,
                                                   std::optional<Stamp> at,
                                                   const MapContent& content) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT before_ns, newest_end_ns, rows_stored, states "
                       "FROM ledger_checkpoint WHERE area_id = ?1 AND version_id = ?2 "
                       "AND before_ns - 1 <= ?3 ORDER BY before_ns DESC LIMIT 1"));
  query.Bind(
      area_id, version_id, at ? ToNanoseconds(*at) : std::numeric_limits<std::int64_t>::max());
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  if (!found) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement later,
        database.Prepare("SELECT before_ns FROM ledger_checkpoint WHERE area_id = ?1 "
                         "AND version_id = ?2 AND rows_stored = 0"));
    later.Bind(area_id, version_id);
    SHIFTMAP_ASSIGN_OR_RETURN(const bool partial, later.Step());
    if (!partial) return std::optional<Checkpoint>();
    return NotFound("{}: this snapshot has probabilities from {:.6f} s on, not at {:.6f} s",
                    database.name(),
                    ToSecondsSinceEpoch(StampFromNanoseconds(later.Int64(0))),
                    ToSecondsSinceEpoch(*at));
  }
  Checkpoint checkpoint;
  checkpoint.before = StampFromNanoseconds(query.Int64(0));
  checkpoint.rows_stored = query.Int64(2) != 0;
  if (!UnpackStates(query.Blob(3), content, &checkpoint.states)) {
    return DataLoss("{}: ledger checkpoint of version row {} at {} ns is damaged",
                    database.name(),
                    version_id,
                    query.Int64(0));
  }
  if (!query.IsNull(1)) checkpoint.states.newest_end = StampFromNanoseconds(query.Int64(1));
  return std::optional<Checkpoint>(std::move(checkpoint));
}

Status InsertCheckpoint(Database& database,
                        std::int64_t area_id,
                        std::int64_t version_id,
                        const Checkpoint& checkpoint) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(
          InsertRowSql("ledger_checkpoint",
                       "area_id, version_id, before_ns, newest_end_ns, rows_stored, states")));
  std::optional<std::int64_t> newest_end;
  if (checkpoint.states.newest_end) newest_end = ToNanoseconds(*checkpoint.states.newest_end);
  const std::string states = PackStates(checkpoint.states);
  row.Bind(area_id,
           version_id,
           ToNanoseconds(checkpoint.before),
           newest_end,
           checkpoint.rows_stored ? 1 : 0,
           BlobView{states});
  return row.Execute();
}

StatusOr<int> DeleteCheckpointsAfter(Database& database, std::int64_t area_id, Stamp begin) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement statement,
      database.Prepare("DELETE FROM ledger_checkpoint WHERE area_id = ?1 AND before_ns > ?2"));
  statement.Bind(area_id, ToNanoseconds(begin));
  SHIFTMAP_RETURN_IF_ERROR(statement.Execute());
  return database.Changes();
}

}  // namespace shiftmap

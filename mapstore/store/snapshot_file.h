// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <utility>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Writes one version of an area into a new store: its content, provenance without trajectories,
/// its newest ledger checkpoint and the rows after it that count, and of the versions that these
/// were reported against the version rows. Published there, compact, not yet durable.
class SnapshotWriter {
 public:
  /// @param wait  For a writer of the source that lets no other reader in. Errors: kAborted if it
  ///              does not go on meanwhile.
  static StatusOr<SnapshotWriter> Open(const Database& source,
                                       const std::string& path,
                                       std::chrono::milliseconds wait);

  /// From here on no writer of the source commits. Errors: as Open; a writer may wait for the
  /// caller's own transaction.
  Status Begin();

  /// Once, after Begin.
  /// @param source  Inside a read transaction that began before Begin.
  /// @param latest  The checkpoint holds no visit that begins later.
  Status Write(Database& source,
               std::int64_t area_id,
               const VersionRow& version,
               const MapContent& content,
               Stamp latest);

 private:
  explicit SnapshotWriter(Database snapshot) : snapshot_(std::move(snapshot)) {}

  Database snapshot_;
};

}  // namespace shiftmap

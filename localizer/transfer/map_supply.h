// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "localizer/maps/map_folder.h"
#include "localizer/transfer/map_client.h"
#include "localizer/transfer/snapshot_keys.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

struct MapSupplyOptions {
  ServerOptions server;
  std::string area;
  std::string maps;               ///< The vehicle's folder of maps.
  std::string spool;              ///< Folder where a snapshot is while it comes.
  std::string socket;             ///< Of `serve`.
  std::vector<std::string> keys;  ///< PEM files of SnapshotKeys; read anew with each snapshot.
  double max_bytes_per_s = 0.0;   ///< 0: as fast as it comes. [B/s]
  MapFolderOptions folder;

  std::function<void(const std::string&)> inform;
  std::function<void()> alive;  ///< Called while a snapshot comes.
};

/// Brings the newest map of an area to a vehicle, and has `serve` take it between two shifts.
/// Threads: one.
class MapSupply {
 public:
  explicit MapSupply(MapSupplyOptions options) : options_(std::move(options)) {}

  /// Puts the newest snapshot into the folder of maps, unless it is there.
  /// Errors: as FetchSnapshot; as MapFolder.
  Status Fetch(const std::stop_token& stop);

  /// A map was fetched that `serve` has not taken.
  bool waits() const { return next_.has_value(); }

  /// Has `serve` take the map if no shift is under way. Deletes older maps then.
  /// Errors: kUnavailable while a shift is under way or `serve` is not there; as MapFolder.
  Status Enable();

 private:
  StatusOr<FolderMap> Brought(MapFolder* folder, MapClient* client);
  Status DeleteOld(MapFolder* folder);

  MapSupplyOptions options_;
  std::optional<FolderMap> next_;
};

}  // namespace shiftmap::transfer

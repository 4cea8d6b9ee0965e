// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "mapstore/map_store.h"
#include "mapstore/server/json_log.h"
#include "mapstore/server/snapshot_feed.h"
#include "mapstore/server/snapshot_folder.h"

namespace shiftmap::server {

struct SnapshotKeeperOptions {
  double poll_s = 1.0;        ///< How often it looks for what others wrote. [s]
  double interval_s = 180.0;  ///< Least time between snapshots of a version. [s]
};

/// Keeps a folder of snapshots up to date with a store that any process may write: a snapshot when
/// a version is published, and when rows have arrived, at most once an interval. Threads: any.
class SnapshotKeeper {
 public:
  /// Looks once, then goes on in a thread of its own.
  /// @param store   Open for reading.
  /// @param folder  As `feed` and `log`, it must outlive this.
  SnapshotKeeper(MapStore store,
                 const SnapshotKeeperOptions& options,
                 SnapshotFolder* folder,
                 SnapshotFeed* feed,
                 JsonLog* log);
  ~SnapshotKeeper();
  SnapshotKeeper(const SnapshotKeeper&) = delete;
  SnapshotKeeper& operator=(const SnapshotKeeper&) = delete;

  /// The areas as they were when it looked last.
  std::vector<AreaState> areas() const;

  /// For how long it has not looked.
  std::chrono::steady_clock::duration idle() const;

 private:
  using Clock = std::chrono::steady_clock;

  // What is known of an area beside its snapshot.
  struct Watched {
    std::int64_t last_change = 0;
    Clock::time_point not_before{};  // After a snapshot that could not be made.
  };

  void Work();
  void Look();
  Status ReadChanges();
  void MakeWhatIsDue();
  bool IsDue(const AreaState& area, const Watched& watched) const;

  MapStore store_;
  const SnapshotKeeperOptions options_;
  SnapshotFolder* const folder_;
  SnapshotFeed* const feed_;
  JsonLog* const log_;

  std::optional<std::int64_t> data_version_;
  std::int64_t position_ = 0;
  std::map<std::string, Watched> watched_;

  mutable std::mutex mutex_;
  std::condition_variable stopped_changed_;
  bool stopped_ = false;
  std::vector<AreaState> areas_;
  Clock::time_point looked_ = Clock::now();
  std::thread thread_;
};

}  // namespace shiftmap::server

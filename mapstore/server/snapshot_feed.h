// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <utility>

#include "mapstore/map/snapshot_info.h"

namespace shiftmap::server {

/// Tells whoever watches an area of its newest snapshot. Threads: any.
class SnapshotFeed {
 public:
  /// Must not block, and must not call the feed.
  using Listener = std::function<void(const SnapshotInfo&)>;

  /// Returns what Leave() takes.
  std::int64_t Join(const std::string& area, Listener listener) {
    const std::lock_guard lock(mutex_);
    listeners_.emplace(++last_, std::pair(area, std::move(listener)));
    return last_;
  }

  /// When it returns, the listener is called no more.
  void Leave(std::int64_t id) {
    const std::lock_guard lock(mutex_);
    listeners_.erase(id);
  }

  void Tell(const SnapshotInfo& snapshot) const {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, listener] : listeners_) {
      if (listener.first == snapshot.area) listener.second(snapshot);
    }
  }

 private:
  mutable std::mutex mutex_;
  std::int64_t last_ = 0;
  std::map<std::int64_t, std::pair<std::string, Listener>> listeners_;
};

}  // namespace shiftmap::server

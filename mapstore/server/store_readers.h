// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <vector>

#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// A few readers of one map store, for as many calls at a time; a call beyond them waits.
/// Threads: any.
class StoreReaders {
 public:
  using Opener = std::function<StatusOr<MapStore>()>;

  /// @param open   Opens the store to read it.
  /// @param count  At least 1.
  StoreReaders(Opener open, int count);

  /// Runs `read` on a reader of its own. Errors: of opening; those of `read`.
  Status Read(const std::function<Status(MapStore&)>& read);

 private:
  const Opener open_;
  std::mutex mutex_;
  std::condition_variable changed_;
  int left_;                    // That may be taken or opened.
  std::vector<MapStore> idle_;  // At most left_.
};

}  // namespace shiftmap::server

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "localizer/transfer/backoff.h"
#include "localizer/transfer/map_client.h"
#include "localizer/transfer/rate_limit.h"
#include "localizer/transfer/snapshot_keys.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

struct FetchOptions {
  std::string area;
  std::string output;  ///< Where the snapshot goes.
  SnapshotKeys keys;   ///< By which it must be signed, if there are any.
  BackoffOptions backoff;
  double max_bytes_per_s = 0.0;  ///< 0: as fast as it comes. [B/s]
  bool dry_run = false;          ///< Only asks which one is the newest.

  /// Called with the share that is here, in [0, 1]; may be null.
  std::function<void(double)> progress;
};

struct FetchResult {
  SnapshotInfo snapshot;
  bool not_changed = false;         ///< It was at `output` already.
  std::int64_t resumed_bytes = 0;   ///< Bytes that were here when the call began.
  std::int64_t received_bytes = 0;  ///< Bytes that came.
  int retries = 0;
};

/// Opens a snapshot as a localizer does, and compares what it holds.
/// Errors: kDataLoss if it is not the map that it should be; as MapStore::Open.
Status CheckSnapshotFile(const std::string& path, const SnapshotInfo& snapshot);

/// Fetches the newest snapshot of an area. Tries again while the link is bad, and goes on where it
/// was cut, also by the end of a process. The file is placed once its hash was verified and it was
/// opened as a localizer opens it.
///
/// A begun snapshot is finished if the newest differs from it by rows of the ledger only: on a slow
/// link there would be another one each time.
///
/// Errors: as MapClient; as PartialFile; kDataLoss if the file or its signature is wrong.
StatusOr<FetchResult> FetchSnapshot(MapClient* client, const FetchOptions& options);

}  // namespace shiftmap::transfer

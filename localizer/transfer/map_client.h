// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "localizer/transfer/server_options.h"
#include "mapstore/map/snapshot_info.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

struct SubmitResult {
  struct SetAside {
    std::string reason;
    std::int64_t rows = 0;
  };
  bool duplicate = false;
  std::int64_t evidence_rows = 0;
  std::vector<SetAside> set_aside;
};

struct UploadState {
  std::int64_t stored_bytes = 0;
  bool complete = false;
};

/// The calls of the map server that a vehicle makes, each once: no try is repeated here.
///
/// Errors, of every call: kUnavailable, kResourceExhausted and kDeadlineExceeded are worth another
/// try. What the server refuses for good is kInvalidArgument, kNotFound, kOutOfRange, kDataLoss,
/// kPermissionDenied. kCancelled after a request to stop. Messages start with `server 'ADDRESS':
/// `.
///
/// Threads: one at a time, but that a stop is requested from any.
class MapClient {
 public:
  /// Connects with the first call, and again with later ones.
  /// @param stop  Ends the call that is under way.
  /// Errors: kNotFound, kInvalidArgument for a file that cannot be read.
  static StatusOr<MapClient> Create(const ServerOptions& options, std::stop_token stop = {});

  MapClient(MapClient&&) noexcept;
  MapClient& operator=(MapClient&&) noexcept;
  ~MapClient();

  /// The newest snapshot of an area.
  StatusOr<SnapshotInfo> GetSnapshot(const std::string& area);

  /// The bytes of a snapshot from an offset on, as they come.
  /// @param take  An error of it ends the call with that error.
  /// Errors also: kDataLoss if the server sends another file, or more than there is.
  Status FetchSnapshot(const SnapshotInfo& snapshot,
                       std::int64_t offset_bytes,
                       const std::function<Status(std::string_view)>& take);

  /// @param report  As EncodeShiftReport() makes it.
  StatusOr<SubmitResult> SubmitReport(const std::string& report);

  StatusOr<UploadState> GetUpload(const std::string& sha256);

  /// Bytes of a log from an offset on, which need not be all that are left.
  /// @param next  The next bytes; empty: no more in this call. An error of it ends the call.
  StatusOr<UploadState> UploadLog(const std::string& sha256,
                                  std::int64_t size_bytes,
                                  std::int64_t offset_bytes,
                                  const std::function<StatusOr<std::string>()>& next);

  /// The newest snapshot of an area, now and whenever there is another one. Returns when the server
  /// ends it, or after the deadline of a stream, which is no error.
  Status WatchSnapshots(const std::string& area,
                        const std::function<void(const SnapshotInfo&)>& take);

  std::stop_token stop() const;

 private:
  struct State;
  explicit MapClient(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap::transfer

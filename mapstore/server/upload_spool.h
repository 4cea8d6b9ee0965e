// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>

#include "mapstore/core/day.h"
#include "mapstore/core/owned_fd.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap::server {

struct UploadLimits {
  std::int64_t max_log_bytes = std::int64_t{4} << 30;       ///< Of one log.
  std::int64_t max_client_bytes = std::int64_t{50} << 30;   ///< Of a vehicle's logs, whole or not.
  std::int64_t max_folder_bytes = std::int64_t{500} << 30;  ///< Of the whole folder.
  std::int64_t keep_free_bytes = std::int64_t{1} << 30;     ///< That stay free on the disk.
  double abandoned_s = 7 * kSecondsPerDay;  ///< After which a part of a log is removed. [s]
};

/// How much of a log is here.
struct UploadProgress {
  std::int64_t stored_bytes = 0;  ///< Durable.
  bool complete = false;
};

/// What comes of run logs over a network: parts that go on where they were cut, also after a crash,
/// then whole logs at `<logs>/<vehicle>/<run's UUID, or the log's hash>.mcap` (FileNameOf). Parts
/// lie in `<logs>/.uploads/<client>/<sha256>.part`; beside them `<sha256>.done` says that the log
/// was whole, whatever became of it since.
///
/// Errors, of every function: kUnavailable if the disk does not take it. Threads: any.
class UploadSpool {
 public:
  /// Errors also: as MakeFolder.
  static StatusOr<std::unique_ptr<UploadSpool>> Open(const std::string& logs,
                                                     const UploadLimits& limits);

  StatusOr<UploadProgress> Progress(const std::string& client, const std::string& sha256);

  /// A log that comes in. Another one of the same client and hash takes its place.
  class Upload {
   public:
    /// Appends bytes. Errors also: kInvalidArgument beyond the size; kAborted if another upload
    /// took its place.
    Status Append(std::string_view bytes);

   private:
    friend class UploadSpool;
    struct Turn;
    class Room;
    std::string sha256_;
    std::string path_;  // Of the part, without its extension.
    std::int64_t size_bytes_ = 0;
    std::int64_t stored_bytes_ = 0;
    std::shared_ptr<Turn> turn_;
    std::int64_t number_ = 0;  // Of this upload among those that took turns.
    std::shared_ptr<Room> room_;
    OwnedFd fd_;
  };

  /// Errors also: kOutOfRange if other than `offset_bytes` are here; kAlreadyExists if the log is
  /// whole; kInvalidArgument if it is too large; kResourceExhausted if a quota is used up.
  StatusOr<Upload> Begin(const std::string& client,
                         const std::string& sha256,
                         std::int64_t size_bytes,
                         std::int64_t offset_bytes);

  /// Makes durable what came, and places the log if it is whole and `accept` takes it.
  /// @param accept  After kPermissionDenied or kInvalidArgument the bytes are dropped, after
  ///                another error they stay.
  /// Errors also: kDataLoss if the hash is another one, kInvalidArgument if it is no run log (the
  /// bytes are dropped); those of `accept`.
  StatusOr<UploadProgress> Finish(Upload upload,
                                  const std::function<Status(const RunInfo&)>& accept);

  /// Removes parts that nobody went on with, and counts what the folder holds.
  void Maintain();

  /// Bytes in the folder, as far as is known.
  std::int64_t folder_bytes() const { return folder_bytes_; }

 private:
  UploadSpool(std::string logs, const UploadLimits& limits)
      : logs_(std::move(logs)), limits_(limits) {}

  std::string PathOf(const std::string& client, const std::string& sha256) const;
  Status Reserve(const std::string& client, std::int64_t more_bytes, Upload::Turn* turn);
  std::shared_ptr<Upload::Turn> TurnOf(const std::string& client, const std::string& path);
  StatusOr<std::string> Place(const Upload& upload, const RunInfo& info) const;

  const std::string logs_;
  const UploadLimits limits_;
  std::atomic<std::int64_t> folder_bytes_ = 0;
  std::mutex mutex_;
  std::map<std::string, std::shared_ptr<Upload::Turn>> turns_;  // By path.
};

}  // namespace shiftmap::server

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "localizer/transfer/map_client.h"
#include "mapstore/core/owned_fd.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

/// The part of a snapshot that came so far, for another process to go on with: `PATH.part`, and
/// `PATH.part.json`, which says of which snapshot. The file is at `path` whole or not at all.
///
/// Bytes that a power failure took are found by the hash of the whole.
///
/// Errors: kNotFound if the folder does not exist; kInvalidArgument if something else than a file
/// is in the place; kUnavailable if the disk does not take it. Messages start with `snapshot
/// 'PATH': `.
class PartialFile {
 public:
  /// Errors also: kUnavailable if another process has it open.
  static StatusOr<PartialFile> Open(const std::string& path);

  /// The snapshot that the bytes are of; nothing if there are none.
  const std::optional<SnapshotInfo>& of() const { return of_; }
  std::int64_t size_bytes() const { return size_bytes_; }

  /// Where the bytes are.
  std::string part() const { return path_ + ".part"; }

  /// Drops what is there and begins another snapshot.
  Status Begin(const SnapshotInfo& snapshot);

  Status Append(std::string_view bytes);

  /// Makes the file durable and renames it to `path`. Call once, last.
  Status Place();

  /// Removes both files. Call once, last.
  void Remove();

 private:
  PartialFile(std::string path, OwnedFd fd) : path_(std::move(path)), fd_(std::move(fd)) {}

  Status About(const Status& status) const;
  Status Truncate();

  std::string path_;
  OwnedFd fd_;
  std::optional<SnapshotInfo> of_;
  std::int64_t size_bytes_ = 0;
};

}  // namespace shiftmap::transfer

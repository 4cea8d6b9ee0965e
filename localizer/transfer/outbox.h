// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/core/owned_fd.h"
#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

/// What became of a file that a shift left.
enum class OutboxState {
  kWaiting,       ///< To be handed in.
  kAcknowledged,  ///< The server has it, durably. Its file is deleted.
  kRefused,       ///< The server will refuse it again. Its file stays.
  kLost,          ///< Its file went before it was handed in.
};

/// As in JSON, e.g. "waiting".
const char* ToString(OutboxState state);

/// A shift report or a run log.
struct OutboxItem {
  std::string name;  ///< `<uuid>.report` or `<uuid>.mcap`.
  std::int64_t bytes = 0;
  std::int64_t written_ns = 0;  ///< When the file was written, since the epoch.
  OutboxState state = OutboxState::kWaiting;
  std::string reason;         ///< Why it was refused or lost.
  std::int64_t since_ns = 0;  ///< When it came into this state, since the epoch.

  bool is_report() const { return name.ends_with(".report"); }
};

struct OutboxOptions {
  std::string files;   ///< The folder where `serve` leaves reports and logs.
  std::string record;  ///< The folder of the record.

  /// Bound of the files. Beyond it the oldest go: refused ones, then logs, then reports. [byte]
  std::int64_t max_bytes = std::int64_t{3} << 30;

  /// Bound of the record: those that need no more attention go first.
  std::size_t max_items = 2000;

  std::function<void(const std::string&)> warn;  ///< Gets a line when something is lost.
};

/// The files of a vehicle that wait for the server, and what became of the others. The record,
/// `outbox.json`, is replaced whole, so that it survives a power failure.
///
/// A file is deleted only after it was recorded that the server acknowledged it, or because the
/// bound asks for it; that is recorded and said.
///
/// Errors, of every function: kUnavailable if the disk does not do it; kNotFound without the
/// folders. Threads: one.
class Outbox {
 public:
  /// A record that is damaged is set aside as `outbox.json.damaged`.
  /// Errors also: kUnavailable if another process has the record.
  static StatusOr<Outbox> Open(const OutboxOptions& options);

  /// Looks for files that came and that went, and applies the bound.
  Status Scan();

  /// What is to be handed in: reports, then logs, of each the oldest first.
  std::vector<OutboxItem> Waiting() const;

  /// The server has it: recorded, then the file is deleted.
  Status Acknowledge(const std::string& name);

  /// The server will not have it.
  Status Refuse(const std::string& name, const std::string& reason);

  /// Refused files wait again.
  Status ForgetRefusals();

  std::string PathOf(const std::string& name) const { return options_.files + "/" + name; }

  const std::map<std::string, OutboxItem>& items() const { return items_; }

 private:
  Outbox(OutboxOptions options, OwnedFd lock)
      : options_(std::move(options)), lock_(std::move(lock)) {}

  Status Load();
  Status Save();
  void Mark(const std::string& name, OutboxState state, const std::string& reason);
  Status Change(const std::string& name, OutboxState state, const std::string& reason);
  Status ApplyBound();
  void ForgetOldest();

  OutboxOptions options_;
  OwnedFd lock_;
  std::map<std::string, OutboxItem> items_;  // By name.
};

}  // namespace shiftmap::transfer

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <future>
#include <string>
#include <utility>
#include <vector>

#include "localizer/live/fleet_messages.h"
#include "proto/core/status.h"

namespace shiftmap::live {

/// The states of the actions that a vehicle was told, until somebody clears them, as VDA 5050 asks:
/// over restarts, in a file. An action that a restart interrupts has failed.
///
/// The file is written by a thread of its own, once a second at most: a power failure loses the
/// last second. Bounded: beyond kMaxActions, the oldest that ended goes.
///
/// Threads: one calls.
class ActionLog {
 public:
  static constexpr std::size_t kMaxActions = 64;
  static constexpr std::size_t kMaxResultBytes = 512;

  explicit ActionLog(std::string path) : path_(std::move(path)) {}

  /// Reads the file, if there is one. Errors: kDataLoss; the log is then empty.
  Status Read();

  /// Null if no action has the name.
  const ActionState* Find(const std::string& action_id) const;

  /// Adds an action whose name is not known. Errors: kResourceExhausted if none has ended of as
  /// many as there may be.
  Status Add(const ActionState& action);

  /// Does nothing for a name that is not known.
  void Set(const std::string& action_id, ActionStatus status, std::string result);

  /// Forgets those that ended.
  void Clear();

  const std::vector<ActionState>& actions() const { return actions_; }

  /// Some that ended went, since nobody cleared them.
  bool overflowed() const { return overflowed_; }

  /// Has a thread write what changed; waits for nothing. Errors: what became of the last time.
  Status StartWrite();

  /// Writes what changed, and waits.
  Status Finish();

 private:
  Status Write() const;

  std::string path_;
  std::vector<ActionState> actions_;
  bool changed_ = false;
  bool overflowed_ = false;
  std::future<Status> writing_;  // Invalid: none under way.
};

}  // namespace shiftmap::live

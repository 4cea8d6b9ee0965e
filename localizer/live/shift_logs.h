// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <future>
#include <set>
#include <string>
#include <utility>

#include "proto/core/status.h"

namespace shiftmap::live {

/// Writes the items of a shift's journal as a run log, in the order of their stamps. The run's UUID
/// is that of the shift's report. Makes no file if the journal has no odometry.
/// Errors: as ReadJournal and RunLogWriter.
Status WriteShiftLog(const std::string& journal, const std::string& log);

/// The run logs of a service's shifts, for the map that is built from them: `<uuid>.mcap` in the
/// state folder, made from the journal after the shift has ended, by a thread of their own. Until
/// the log is there the journal stays, as `<uuid>.journal`, also over a restart.
///
/// The oldest logs are deleted so that all take no more than a bound, and no more than they leave
/// free of the disk.
///
/// Threads: one calls.
class ShiftLogs {
 public:
  /// @param max_bytes  Of all logs; 0: none are made.
  ShiftLogs(std::string folder, std::int64_t max_bytes)
      : folder_(std::move(folder)), max_bytes_(max_bytes) {}

  /// Takes the journal of a shift that has ended, which is closed. Another process would go on with
  /// it otherwise; so it is deleted if it cannot be renamed, an error then (kUnavailable).
  Status Take(const std::string& journal, const std::string& uuid);

  /// Makes logs of journals that wait, if none is being made. Never waits itself.
  /// Errors: what became of the last one, once; that journal is not tried again by this process.
  Status GoOn();

  /// Waits until all are made.
  Status Finish();

 private:
  std::string folder_;
  std::int64_t max_bytes_;
  bool waiting_ = true;          // There may be journals that were not tried.
  std::set<std::string> tried_;  // Journals.
  std::future<Status> making_;   // Invalid: none under way.
};

}  // namespace shiftmap::live

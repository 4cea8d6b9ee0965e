// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <set>
#include <string>

#include "proto/core/status.h"

namespace shiftmap::live {

/// Writes the items of a shift's journal as a run log, in the order of their stamps. The run's UUID
/// is that of the shift's report. Makes no file if the journal has no odometry.
/// Errors: as ReadJournal and RunLogWriter.
Status WriteShiftLog(const std::string& journal, const std::string& log);

/// Recordings of a service's shifts, made of the journals after the run logs.
struct ShiftRecordings {
  std::string folder;          ///< Empty: none are made.
  std::int64_t max_bytes = 0;  ///< Of all recordings in the folder.

  /// Makes the recording of a journal, or leaves off with kAborted once `stop` is true. Called by a
  /// thread of the lowest priority.
  std::function<Status(
      const std::string& journal, const std::string& path, const std::atomic<bool>& stop)>
      make = {};
};

/// The run logs of a service's shifts, for the map that is built from them: `<uuid>.mcap` in the
/// state folder, made from the journal after the shift has ended, by a thread of their own. Until
/// the log is there the journal stays, as `<uuid>.journal`, also over a restart.
///
/// Recordings, if there are to be any, come after all logs: `<uuid>.mcap` in a folder of their own.
/// Until then the journal stays as `<uuid>.unrecorded`, and meanwhile as `<uuid>.recording`: one
/// that ends the process is not tried again.
///
/// The oldest logs are deleted so that all take no more than a bound, and no more than they leave
/// free of the disk; recordings likewise.
///
/// Threads: one calls.
class ShiftLogs {
 public:
  /// @param max_bytes  Of all logs; 0: none are made.
  ShiftLogs(std::string folder, std::int64_t max_bytes, ShiftRecordings recordings = {});

  /// Leaves off a recording.
  ~ShiftLogs();
  ShiftLogs(ShiftLogs&&) = default;
  ShiftLogs& operator=(ShiftLogs&&) = default;

  /// Takes the journal of a shift that has ended, which is closed. Another process would go on with
  /// it otherwise; so it is deleted if it cannot be renamed, an error then (kUnavailable).
  Status Take(const std::string& journal, const std::string& uuid);

  /// Makes logs and recordings of journals that wait, if none is being made. Never waits itself.
  /// Errors: what became of the last one, once, and what the shift lacks; that journal is not tried
  /// again by this process.
  Status StepCallback() { return Begin(false); }

  /// Waits until all logs are made. Recordings are left to the next process.
  Status Finish();

 private:
  Status Begin(bool ending);
  bool records() const { return !recordings_.folder.empty(); }

  // The oldest journal with an ending that was not tried; empty: none.
  std::string NextJournal(const char* ending);

  std::string folder_;
  std::int64_t max_bytes_;
  ShiftRecordings recordings_;
  std::shared_ptr<std::atomic<bool>> stop_ = std::make_shared<std::atomic<bool>>(false);
  bool waiting_ = true;          // There may be journals that were not tried.
  std::set<std::string> tried_;  // Journals.
  std::future<Status> making_;   // Invalid: none under way.
};

}  // namespace shiftmap::live

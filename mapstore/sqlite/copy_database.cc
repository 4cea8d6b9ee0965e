// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/copy_database.h"

#include <sqlite3.h>

#include <chrono>
#include <memory>
#include <thread>

#include "mapstore/sqlite/sqlite_status.h"

namespace shiftmap {
namespace {

constexpr int kPagesPerStep = 2048;
constexpr int kMaxRestarts = 3;
constexpr std::chrono::milliseconds kPause(2);

// Waits for a lock happen inside a step already, by the busy handlers.
constexpr int kMaxBusySteps = 20;

}  // namespace

Status CopyDatabase(Database& from, Database& to) {
  using Backup = std::unique_ptr<sqlite3_backup, int (*)(sqlite3_backup*)>;
  Backup backup(sqlite3_backup_init(to.handle(), "main", from.handle(), "main"),
                sqlite3_backup_finish);
  if (!backup) return SqliteStatus(to.handle(), sqlite3_errcode(to.handle()), to.name());
  int restarts = 0;
  int busy_steps = 0;
  int left = -1;
  for (;;) {
    const int code =
        sqlite3_backup_step(backup.get(), restarts < kMaxRestarts ? kPagesPerStep : -1);
    if (code == SQLITE_DONE) break;
    if (code == SQLITE_BUSY || code == SQLITE_LOCKED) {
      if (++busy_steps > kMaxBusySteps) {
        return SqliteStatus(nullptr, code, from.name());
      }
    } else if (code != SQLITE_OK) {
      return SqliteStatus(nullptr, code, to.name());
    }
    const int now_left = sqlite3_backup_remaining(backup.get());
    if (left >= 0 && now_left > left) ++restarts;
    left = now_left;
    std::this_thread::sleep_for(kPause);
  }
  const int code = sqlite3_backup_finish(backup.release());
  return SqliteStatus(to.handle(), code, to.name());
}

}  // namespace shiftmap

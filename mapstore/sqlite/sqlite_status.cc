// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/sqlite_status.h"

#include <sqlite3.h>

namespace shiftmap {

Status SqliteStatus(sqlite3* db, int code, const std::string& name) {
  const std::string detail = db != nullptr ? sqlite3_errmsg(db) : sqlite3_errstr(code);
  switch (code & 0xff) {
    case SQLITE_OK:
    case SQLITE_ROW:
    case SQLITE_DONE:
      return OkStatus();
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return Unavailable("{}: locked by another process", name);
    case SQLITE_NOTADB:
      return FailedPrecondition("{}: not a map store", name);
    case SQLITE_CORRUPT:
      return DataLoss("{}: damaged: {}", name, detail);
    case SQLITE_READONLY:
      if (code == SQLITE_READONLY_ROLLBACK) {
        return Unavailable("{}: an interrupted write must be rolled back: open it for writing once",
                           name);
      }
      return Unavailable("{}: cannot be written: {}", name, detail);
    case SQLITE_FULL:
    case SQLITE_IOERR:
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
    case SQLITE_AUTH:
    case SQLITE_NOMEM:
    case SQLITE_PROTOCOL:
    case SQLITE_INTERRUPT:
      return Unavailable("{}: {} (sqlite code {})", name, detail, code);
    case SQLITE_TOOBIG:
      return InvalidArgument("{}: a value is too large for the store: {}", name, detail);
    default:
      return Internal("{}: {} (sqlite code {})", name, detail, code);
  }
}

}  // namespace shiftmap

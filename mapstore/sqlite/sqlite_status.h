// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "proto/core/status.h"

struct sqlite3;

namespace shiftmap {

/// What an SQLite result code means to the user of a store.
///
///   busy, locked                            kUnavailable: another process holds it
///   full, I/O error, read-only, cannot open kUnavailable
///   not a database                          kFailedPrecondition: 'not a map store'
///   corrupt                                 kDataLoss
///   too big                                 kInvalidArgument
///   everything else                         kInternal: our SQL is wrong
///
/// @param db    For its message; may be null.
/// @param name  Starts the message, e.g. "map store 'a.db'".
Status SqliteStatus(sqlite3* db, int code, const std::string& name);

}  // namespace shiftmap

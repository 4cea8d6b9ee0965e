// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "proto/core/status.h"

namespace shiftmap {

/// Makes `temporary`, a database that is closed, durable and renames it to `destination`. A journal
/// that an interrupted write left beside `destination` belongs to the file that is replaced: SQLite
/// would roll it back into the file that comes. So it is rolled back into the old file first, or
/// removed if there is none.
/// Errors: as SyncAndRename; as Database::Open of the old file if it has a journal.
Status PlaceDatabase(const std::string& temporary, const std::string& destination);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Replaces everything in `to` by what is in `from`, page by page, while others read and write
/// `from`: the lock is given up between the steps. `to` changes in one transaction, or not at all.
///
/// Others' commits start the copy over; after a few times the lock is kept to the end, so that it
/// does end.
Status CopyDatabase(Database& from, Database& to);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Opens a file that is a map store of a schema that this build reads. With kReadWriteCreate, a
/// file that is missing or empty becomes an empty store first.
/// Errors: as Database::Open; kFailedPrecondition if it is another kind of file or a newer schema.
StatusOr<Database> OpenStoreFile(const std::string& path, const Database::Options& options);

}  // namespace shiftmap

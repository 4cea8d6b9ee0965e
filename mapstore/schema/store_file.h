// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Opens a file that is a map store of this build's schema. With kReadWriteCreate, a file that is
/// missing or empty becomes an empty store first. Opening never migrates.
/// Errors: as Database::Open; kFailedPrecondition if it is another kind of file or another schema,
/// or a snapshot that is opened for writing.
StatusOr<Database> OpenStoreFile(const std::string& path, const Database::Options& options);

/// The schema version of an open map store, whichever it is.
/// Errors: kFailedPrecondition if it is another kind of file.
StatusOr<std::int64_t> StoredSchemaVersion(Database& database);

/// Whether a map store is a snapshot: something is published in it, but it has no audit log.
StatusOr<bool> IsSnapshot(Database& database);

/// For who would write. Errors: kFailedPrecondition if it is a snapshot.
Status CheckNoSnapshot(Database& database);

/// Runs the migrations from schema `from` up to this build's, inside the caller's transaction.
Status Migrate(Database& database, std::int64_t from);

}  // namespace shiftmap

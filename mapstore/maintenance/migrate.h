// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "proto/core/status.h"

namespace shiftmap {

struct MigrateResult {
  std::int64_t from = 0;  ///< Schema versions.
  std::int64_t to = 0;
  std::string backup;  ///< Where the store as it was is kept.
};

/// Brings a map store to the schema of this build, in one transaction, after a verified copy of it
/// was made durable.
/// @param backup  Path of the copy; empty: `<path>.schema<N>.bak`. Must not exist.
/// @param dry_run  Says what would be done, writes nothing.
/// Errors: kAlreadyExists if there is nothing to do; kFailedPrecondition if the file is no store,
/// is of a newer schema, or if `backup` exists; else as MapStore. After an error the store is as it
/// was, and no copy is left.
StatusOr<MigrateResult> MigrateStore(const std::string& path,
                                     const std::string& backup,
                                     bool dry_run = false);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "proto/core/status.h"

namespace shiftmap {

struct BackupResult {
  std::string sha256;  ///< Of the backup file.
  std::string digest;  ///< Over its rows: that of the store it was made from, or restored to.
  std::uintmax_t bytes = 0;
};

/// Copies a store while others read and write it. The copy is verified as a whole, made durable,
/// and then renamed into place; `destination` is replaced.
/// Errors also: kDataLoss if what was copied does not verify; kInvalidArgument if `destination` is
/// the store itself.
StatusOr<BackupResult> BackupStore(const std::string& path, const std::string& destination);

struct RestoreResult {
  BackupResult restored;            ///< Of the store as it is now; `sha256` of the backup.
  std::optional<std::string> kept;  ///< Where the store that was there is kept.
};

/// Makes the store at `path` what `backup` is. The backup is verified first; that the rows are the
/// same afterwards is proven by their digest. A store that is there already is replaced only with
/// `replace`: it is copied to `<path>.before-restore-<n>`, then overwritten in one transaction, so
/// that processes which have it open go on with what was restored. What is too damaged to be copied
/// is renamed to that.
/// Errors also: kFailedPrecondition if there is a store and not `replace`; kDataLoss if the backup
/// does not verify; kInvalidArgument if it is a snapshot.
StatusOr<RestoreResult> RestoreStore(const std::string& backup,
                                     const std::string& path,
                                     bool replace);

}  // namespace shiftmap

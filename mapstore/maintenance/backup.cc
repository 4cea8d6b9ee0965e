// SPDX-License-Identifier: Apache-2.0
#include "mapstore/maintenance/backup.h"

#include <filesystem>

#include "mapstore/maintenance/verify.h"
#include "mapstore/map/sha256.h"
#include "mapstore/schema/store_file.h"
#include "mapstore/sqlite/copy_database.h"
#include "mapstore/sqlite/digest.h"
#include "mapstore/sqlite/place_database.h"
#include "mapstore/sqlite/temporary_database.h"
#include "mapstore/sqlite/transaction.h"

namespace shiftmap {
namespace {

StatusOr<std::string> DigestOf(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, OpenStoreFile(path, {}));
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction,
                            Transaction::Begin(database, Transaction::Kind::kRead));
  return DigestRows(database);
}

StatusOr<BackupResult> Describe(const std::string& path) {
  BackupResult result;
  SHIFTMAP_ASSIGN_OR_RETURN(result.digest, DigestOf(path));
  SHIFTMAP_ASSIGN_OR_RETURN(result.sha256, HashFile(path));
  std::error_code error;
  result.bytes = std::filesystem::file_size(path, error);
  return result;
}

Status RequireClean(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VerifyResult verified, VerifyStore(path));
  if (verified.clean()) return OkStatus();
  const Defect& first = verified.defects.front();
  return DataLoss("map store '{}': {} defects; first: {} {}: {}",
                  path,
                  verified.defect_count,
                  first.table,
                  first.row,
                  first.problem);
}

// A snapshot has one area, without its history.
Status RequireNoSnapshot(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, OpenStoreFile(path, {}));
  SHIFTMAP_ASSIGN_OR_RETURN(const bool snapshot, IsSnapshot(database));
  if (!snapshot) return OkStatus();
  return InvalidArgument("{}: is a snapshot, not a backup of a store", database.name());
}

// Copies a store into a new file.
Status CopyToFile(const std::string& from, const std::string& to) {
  SHIFTMAP_ASSIGN_OR_RETURN(Database source, OpenStoreFile(from, {}));
  Database::Options options;
  options.mode = Database::Mode::kReadWriteCreate;
  SHIFTMAP_ASSIGN_OR_RETURN(Database copy, Database::Open(to, options));
  return CopyDatabase(source, copy);
}

bool Exists(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

std::string FreeName(const std::string& path) {
  for (int i = 1;; ++i) {
    const std::string name = fmt::format("{}.before-restore-{}", path, i);
    if (!Exists(name)) return name;
  }
}

// Moves a file that is no sound store out of the way, with its journal.
Status MoveAside(const std::string& path, const std::string& to) {
  for (const char* suffix : {"", "-journal"}) {
    if (!Exists(path + suffix)) continue;
    std::error_code error;
    std::filesystem::rename(path + suffix, to + suffix, error);
    if (error) {
      return Unavailable(
          "file '{}': cannot be renamed to '{}': {}", path + suffix, to + suffix, error.message());
    }
  }
  return OkStatus();
}

// A store for a writer that lets nobody else in until it is closed.
StatusOr<Database> OpenExclusively(const std::string& path) {
  Database::Options options;
  options.mode = Database::Mode::kReadWrite;
  SHIFTMAP_ASSIGN_OR_RETURN(Database store, OpenStoreFile(path, options));
  SHIFTMAP_RETURN_IF_ERROR(store.Execute("PRAGMA locking_mode=EXCLUSIVE; BEGIN EXCLUSIVE; COMMIT"));
  return store;
}

// Copies the store at `path` to `kept` and overwrites it with the backup, in place and without a
// gap in which another process could write. What fails before anything is overwritten is
// `*replaceable`.
Status KeepAndOverwrite(const std::string& backup,
                        const std::string& path,
                        const std::string& kept,
                        bool* replaceable) {
  *replaceable = true;
  SHIFTMAP_ASSIGN_OR_RETURN(Database store, OpenExclusively(path));
  SHIFTMAP_ASSIGN_OR_RETURN(const TemporaryDatabase temporary, TemporaryDatabase::Create(kept));
  {
    Database::Options options;
    options.mode = Database::Mode::kReadWriteCreate;
    SHIFTMAP_ASSIGN_OR_RETURN(Database copy, Database::Open(temporary.path(), options));
    SHIFTMAP_RETURN_IF_ERROR(CopyDatabase(store, copy));
  }
  *replaceable = false;
  SHIFTMAP_RETURN_IF_ERROR(PlaceDatabase(temporary.path(), kept));
  SHIFTMAP_ASSIGN_OR_RETURN(Database source, OpenStoreFile(backup, {}));
  return CopyDatabase(source, store);
}

}  // namespace

StatusOr<BackupResult> BackupStore(const std::string& path, const std::string& destination) {
  std::error_code error;
  if (std::filesystem::equivalent(path, destination, error)) {
    return InvalidArgument("map store '{}': backup would replace the store itself", path);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const TemporaryDatabase temporary,
                            TemporaryDatabase::Create(destination));
  SHIFTMAP_RETURN_IF_ERROR(CopyToFile(path, temporary.path()));
  SHIFTMAP_RETURN_IF_ERROR(RequireClean(temporary.path()));
  SHIFTMAP_ASSIGN_OR_RETURN(BackupResult result, Describe(temporary.path()));
  SHIFTMAP_RETURN_IF_ERROR(PlaceDatabase(temporary.path(), destination));
  return result;
}

StatusOr<RestoreResult> RestoreStore(const std::string& backup,
                                     const std::string& path,
                                     bool replace) {
  std::error_code error;
  if (std::filesystem::equivalent(path, backup, error)) {
    return InvalidArgument("map store '{}': cannot be restored from itself", path);
  }
  SHIFTMAP_RETURN_IF_ERROR(RequireNoSnapshot(backup));
  SHIFTMAP_RETURN_IF_ERROR(RequireClean(backup));
  SHIFTMAP_ASSIGN_OR_RETURN(const BackupResult expected, Describe(backup));
  RestoreResult result;
  bool done = false;
  if (Exists(path)) {
    if (!replace) {
      return FailedPrecondition("map store '{}': exists already, and is replaced only if asked",
                                path);
    }
    result.kept = FreeName(path);
    bool replaceable = false;
    const Status status = KeepAndOverwrite(backup, path, *result.kept, &replaceable);
    const bool damaged =
        status.code() == StatusCode::kDataLoss || status.code() == StatusCode::kFailedPrecondition;
    if (!status.ok() && !(replaceable && damaged)) return status;
    done = status.ok();
    if (!done) SHIFTMAP_RETURN_IF_ERROR(MoveAside(path, *result.kept));
  }
  if (!done) {
    SHIFTMAP_ASSIGN_OR_RETURN(const TemporaryDatabase temporary, TemporaryDatabase::Create(path));
    SHIFTMAP_RETURN_IF_ERROR(CopyToFile(backup, temporary.path()));
    SHIFTMAP_RETURN_IF_ERROR(PlaceDatabase(temporary.path(), path));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(result.restored, Describe(path));
  result.restored.sha256 = expected.sha256;
  if (result.restored.digest != expected.digest) {
    return DataLoss("map store '{}': rows have digest {}, those of the backup {}",
                    path,
                    result.restored.digest,
                    expected.digest);
  }
  return result;
}

}  // namespace shiftmap

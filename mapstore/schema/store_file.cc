// SPDX-License-Identifier: Apache-2.0
#include "mapstore/schema/store_file.h"

#include <cstdint>
#include <filesystem>

#include "mapstore/core/folder.h"
#include "mapstore/schema/schema.h"
#include "mapstore/sqlite/place_database.h"
#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/sqlite/temporary_database.h"
#include "mapstore/sqlite/transaction.h"

namespace shiftmap {
namespace {

// Rows have checksums since this schema.
constexpr std::int64_t kChecksumSchema = 10;

StatusOr<bool> IsEmpty(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t application,
                            database.QueryInt64("PRAGMA application_id"));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t objects,
                            database.QueryInt64("SELECT count(*) FROM sqlite_schema"));
  return application == 0 && objects == 0;
}

Status MakeSchema(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction,
                            Transaction::Begin(database, Transaction::Kind::kWrite));
  // Another process may have been faster.
  SHIFTMAP_ASSIGN_OR_RETURN(const bool empty, IsEmpty(database));
  if (!empty) return OkStatus();
  SHIFTMAP_RETURN_IF_ERROR(Migrate(database, 0));
  return transaction.Commit();
}

// Makes a store under another name and renames it to `path`: what a full disk or a power cut leaves
// is never a file that is no store.
Status MakeStoreFile(const std::string& path, const Database::Options& options) {
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  SHIFTMAP_ASSIGN_OR_RETURN(const FolderLock lock,
                            FolderLock::Take(folder.empty() ? "." : folder.string()));
  std::error_code error;
  if (std::filesystem::exists(path, error)) return OkStatus();  // Another process was faster.
  SHIFTMAP_ASSIGN_OR_RETURN(const TemporaryDatabase temporary, TemporaryDatabase::Create(path));
  {
    SHIFTMAP_ASSIGN_OR_RETURN(Database database, Database::Open(temporary.path(), options));
    SHIFTMAP_RETURN_IF_ERROR(MakeSchema(database));
  }
  return PlaceDatabase(temporary.path(), path);
}

}  // namespace

StatusOr<Database> OpenStoreFile(const std::string& path, const Database::Options& options) {
  const bool creates = options.mode == Database::Mode::kReadWriteCreate;
  std::error_code error;
  const auto type = std::filesystem::symlink_status(path, error).type();
  if (creates && type == std::filesystem::file_type::not_found) {
    SHIFTMAP_RETURN_IF_ERROR(Database::CheckWritable(path));
    SHIFTMAP_RETURN_IF_ERROR(
        Annotate(MakeStoreFile(path, options), "map store '{}': cannot be made", path));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, Database::Open(path, options));
  if (creates) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool empty, IsEmpty(database));
    if (empty) SHIFTMAP_RETURN_IF_ERROR(MakeSchema(database));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t version, StoredSchemaVersion(database));
  if (version == kSchemaVersion) {
    if (options.mode != Database::Mode::kReadOnly)
      SHIFTMAP_RETURN_IF_ERROR(CheckNoSnapshot(database));
    return database;
  }
  return FailedPrecondition("{}: schema version {}, this build reads {}{}",
                            database.name(),
                            version,
                            kSchemaVersion,
                            version < kSchemaVersion ? "; 'shiftmap-inspect migrate' updates it"
                                                     : "; it needs a newer build");
}

StatusOr<std::int64_t> StoredSchemaVersion(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t application,
                            database.QueryInt64("PRAGMA application_id"));
  if (application != kApplicationId) {
    return FailedPrecondition("{}: not a map store: application id {:#010x}, expected {:#010x}",
                              database.name(),
                              static_cast<std::uint32_t>(application),
                              kApplicationId);
  }
  return database.QueryInt64("PRAGMA user_version");
}

StatusOr<bool> IsSnapshot(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::int64_t snapshot,
      database.QueryInt64("SELECT EXISTS (SELECT 1 FROM area WHERE published_version_id IS NOT "
                          "NULL) AND NOT EXISTS (SELECT 1 FROM audit)"));
  return snapshot != 0;
}

Status CheckNoSnapshot(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(const bool snapshot, IsSnapshot(database));
  if (!snapshot) return OkStatus();
  return FailedPrecondition(
      "{}: is a snapshot, which is never written to: expected the store that it was exported from",
      database.name());
}

Status Migrate(Database& database, std::int64_t from) {
  for (std::int64_t version = from; version < kSchemaVersion; ++version) {
    const Status migrated = database.Execute(kMigrations[static_cast<std::size_t>(version)]);
    // The steps are right for their schema: SQL that fails is about another one.
    if (migrated.code() == StatusCode::kInternal) {
      return DataLoss("{}: damaged: its tables are not those of schema {}, its version: {}",
                      database.name(),
                      version,
                      Message(migrated));
    }
    SHIFTMAP_RETURN_IF_ERROR(migrated);
    if (version + 1 != kChecksumSchema) continue;
    for (const char* const table : kChecksumTables) {
      SHIFTMAP_RETURN_IF_ERROR(SetChecksums(database, table));
    }
  }
  return OkStatus();
}

}  // namespace shiftmap

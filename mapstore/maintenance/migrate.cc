// SPDX-License-Identifier: Apache-2.0
#include "mapstore/maintenance/migrate.h"

#include <filesystem>
#include <optional>

#include "mapstore/core/folder.h"
#include "mapstore/schema/schema.h"
#include "mapstore/schema/store_file.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/sqlite/place_database.h"
#include "mapstore/sqlite/temporary_database.h"
#include "mapstore/sqlite/transaction.h"
#include "mapstore/store/audit_rows.h"

namespace shiftmap {
namespace {

// What a migration could have broken.
Status Check(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t dangling,
                            database.QueryInt64("SELECT count(*) FROM pragma_foreign_key_check"));
  if (dangling > 0) return DataLoss("{}: {} dangling references", database.name(), dangling);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t sound,
                            database.QueryInt64("SELECT count(*) FROM pragma_integrity_check WHERE "
                                                "integrity_check = 'ok'"));
  if (sound != 1) return DataLoss("{}: fails SQLite's integrity check", database.name());
  return OkStatus();
}

// What a snapshot has of the time before its begin may be filtered in the old way, and the rows to
// do it again are not in it.
Status RefuseSnapshot(Database& database, std::int64_t schema) {
  constexpr std::int64_t kSameFilter = 6;  // Since this schema.
  if (schema >= kSameFilter) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::int64_t has_column,
      database.QueryInt64("SELECT count(*) FROM pragma_table_info('ledger_checkpoint') "
                          "WHERE name = 'rows_stored'"));
  if (has_column == 0) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::int64_t snapshots,
      database.QueryInt64("SELECT count(*) FROM ledger_checkpoint WHERE rows_stored = 0"));
  if (snapshots == 0) return OkStatus();
  return FailedPrecondition("{}: is a snapshot: migrate its store, and export it again",
                            database.name());
}

Status CopyTo(Database& database, const std::string& backup) {
  SHIFTMAP_ASSIGN_OR_RETURN(const TemporaryDatabase temporary, TemporaryDatabase::Create(backup));
  {
    SHIFTMAP_ASSIGN_OR_RETURN(Statement statement, database.Prepare("VACUUM INTO ?1"));
    statement.Bind(temporary.path());
    SHIFTMAP_RETURN_IF_ERROR(statement.Execute());
  }
  {
    SHIFTMAP_ASSIGN_OR_RETURN(Database copy, Database::Open(temporary.path(), {}));
    SHIFTMAP_RETURN_IF_ERROR(Check(copy));
  }
  return PlaceDatabase(temporary.path(), backup);
}

Status MigrateInPlace(Database& database, const MigrateResult& result) {
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction,
                            Transaction::Begin(database, Transaction::Kind::kWrite));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t still, StoredSchemaVersion(database));
  if (still != result.from) {
    return MakeStatus(
        StatusCode::kAborted, "{}: another process migrated it meanwhile", database.name());
  }
  SHIFTMAP_RETURN_IF_ERROR(Migrate(database, result.from));
  // A snapshot stays one.
  SHIFTMAP_ASSIGN_OR_RETURN(const bool snapshot, IsSnapshot(database));
  if (!snapshot) {
    SHIFTMAP_RETURN_IF_ERROR(InsertAudit(database,
                                         std::nullopt,
                                         AuditAction::kMigrate,
                                         fmt::format("schema {} to {}", result.from, result.to)));
  }
  SHIFTMAP_RETURN_IF_ERROR(Check(database));
  return transaction.Commit();
}

}  // namespace

StatusOr<MigrateResult> MigrateStore(const std::string& path,
                                     const std::string& backup,
                                     bool dry_run) {
  Database::Options options;
  options.mode = dry_run ? Database::Mode::kReadOnly : Database::Mode::kReadWrite;
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, Database::Open(path, options));
  // Another one may make the same backup.
  std::optional<FolderLock> lock;
  if (!dry_run) {
    const std::filesystem::path folder = std::filesystem::path(path).parent_path();
    SHIFTMAP_ASSIGN_OR_RETURN(lock, FolderLock::Take(folder.empty() ? "." : folder.string()));
  }
  MigrateResult result;
  result.to = kSchemaVersion;
  SHIFTMAP_ASSIGN_OR_RETURN(result.from, StoredSchemaVersion(database));
  if (result.from > kSchemaVersion || result.from < 1) {
    return FailedPrecondition("{}: schema version {}, this build migrates 1..{}",
                              database.name(),
                              result.from,
                              kSchemaVersion - 1);
  }
  if (result.from == kSchemaVersion) {
    return MakeStatus(
        StatusCode::kAlreadyExists, "{}: is of schema {} already", database.name(), result.from);
  }
  SHIFTMAP_RETURN_IF_ERROR(RefuseSnapshot(database, result.from));
  result.backup = backup.empty() ? fmt::format("{}.schema{}.bak", path, result.from) : backup;
  std::error_code error;
  if (std::filesystem::exists(result.backup, error)) {
    return FailedPrecondition(
        "{}: backup '{}' exists already, as after a migration that was cut off: delete it, or name "
        "another one",
        database.name(),
        result.backup);
  }
  if (dry_run) return result;
  SHIFTMAP_RETURN_IF_ERROR(CopyTo(database, result.backup));

  const Status migrated = MigrateInPlace(database, result);
  if (migrated.ok()) return result;
  // The same command must go on once there is room on the disk.
  const StatusOr<std::int64_t> left = StoredSchemaVersion(database);
  if (left.ok() && *left == result.from) std::filesystem::remove(result.backup, error);
  return migrated;
}

}  // namespace shiftmap

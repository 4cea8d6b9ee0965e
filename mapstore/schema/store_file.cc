// SPDX-License-Identifier: Apache-2.0
#include "mapstore/schema/store_file.h"

#include <cstdint>

#include "mapstore/schema/schema.h"
#include "mapstore/sqlite/transaction.h"

namespace shiftmap {
namespace {

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
  SHIFTMAP_RETURN_IF_ERROR(database.Execute(kInitSql));
  return transaction.Commit();
}

Status CheckSchema(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t application,
                            database.QueryInt64("PRAGMA application_id"));
  if (application != kApplicationId) {
    return FailedPrecondition("{}: not a map store: application id {:#010x}, expected {:#010x}",
                              database.name(),
                              static_cast<std::uint32_t>(application),
                              kApplicationId);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t version, database.QueryInt64("PRAGMA user_version"));
  if (version < kOldestSchemaVersion || version > kSchemaVersion) {
    return FailedPrecondition("{}: schema version {}, this build reads {}..{}",
                              database.name(),
                              version,
                              kOldestSchemaVersion,
                              kSchemaVersion);
  }
  return OkStatus();
}

}  // namespace

StatusOr<Database> OpenStoreFile(const std::string& path, const Database::Options& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, Database::Open(path, options));
  if (options.mode == Database::Mode::kReadWriteCreate) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool empty, IsEmpty(database));
    if (empty) SHIFTMAP_RETURN_IF_ERROR(MakeSchema(database));
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckSchema(database));
  return database;
}

}  // namespace shiftmap

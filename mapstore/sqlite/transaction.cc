// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/transaction.h"

#include <utility>

namespace shiftmap {

StatusOr<Transaction> Transaction::Begin(Database& database, Kind kind) {
  if (kind == Kind::kWrite && !database.writable()) {
    return FailedPrecondition("{}: opened read-only", database.name());
  }
  SHIFTMAP_RETURN_IF_ERROR(
      database.Execute(kind == Kind::kWrite ? "BEGIN IMMEDIATE" : "BEGIN DEFERRED"));
  return Transaction(database);
}

Transaction::Transaction(Transaction&& other) noexcept
    : database_(std::exchange(other.database_, nullptr)) {}

Transaction::~Transaction() {
  // An error may have rolled back already; then this fails, and nothing is left to do.
  if (database_ != nullptr) database_->Execute("ROLLBACK").IgnoreError();
}

Status Transaction::Commit() {
  SHIFTMAP_RETURN_IF_ERROR(database_->Execute("COMMIT"));
  database_ = nullptr;
  return OkStatus();
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A transaction; rolled back at its end unless committed. Statements of the database that are
/// stepped through inside must end before it does.
class Transaction {
 public:
  enum class Kind {
    kRead,   ///< All reads see the file as of the first one.
    kWrite,  ///< Takes the write lock at once, so that what was read cannot change before Commit.
  };

  static StatusOr<Transaction> Begin(Database& database, Kind kind);

  Transaction(Transaction&& other) noexcept;
  Transaction& operator=(Transaction&&) = delete;
  ~Transaction();

  /// Makes the writes durable. After an error nothing is written.
  Status Commit();

 private:
  explicit Transaction(Database& database) : database_(&database) {}

  Database* database_;  // Null after Commit.
};

}  // namespace shiftmap

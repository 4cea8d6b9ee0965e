// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "mapstore/sqlite/statement.h"
#include "proto/core/status.h"

struct sqlite3;

namespace shiftmap {

/// A connection to one SQLite file, set up for durability and for distrust of what is in the file:
/// rollback journal with synchronous=EXTRA, foreign keys on, schema not trusted, triggers and views
/// off, cell sizes checked, sizes limited.
///
/// Errors: as SqliteStatus; every message starts with name(). Threads: one thread per object.
class Database {
 public:
  enum class Mode {
    kReadOnly,         ///< Works on a read-only mount.
    kReadWrite,        ///< The file must exist.
    kReadWriteCreate,  ///< Makes an empty file if there is none.
  };

  struct Options {
    Mode mode = Mode::kReadOnly;
    /// How long a call waits for a lock that another connection holds before kUnavailable.
    std::chrono::milliseconds busy_timeout{5000};
    /// Called once per wait that takes noticeably long.
    std::function<void()> on_wait = nullptr;
    /// Otherwise kFailedPrecondition: locks of network file systems do not hold.
    bool allow_network_file_system = false;
    /// Of kReadOnly: nobody writes the file meanwhile. It is read without locks, and nothing is
    /// made beside it; a write-ahead log that is there is not read.
    bool immutable = false;
    /// Starts messages, once the file is open, instead of "map store 'PATH'".
    std::string name = {};
  };

  /// A database that no file stands behind, for what needs a second schema to compare with.
  static StatusOr<Database> OpenInMemory();

  /// Errors also: kNotFound if the file, or the folder to create it in, does not exist;
  /// kFailedPrecondition if something other than a regular file is there.
  static StatusOr<Database> Open(const std::string& path, const Options& options);

  /// Whether the database could be written, or made, as far as permissions tell. Leaves no trace.
  /// Errors: as Open(); kUnavailable if the file, or the folder that its journal needs, may not be
  /// written to.
  static Status CheckWritable(const std::string& path);

  Database(Database&&) noexcept;
  Database& operator=(Database&&) noexcept;
  ~Database();

  /// Runs SQL without parameters; several statements, separated by semicolons.
  Status Execute(const std::string& sql);

  /// A statement, compiled at its first use and kept. SQL that does not fit the schema in the file
  /// is kDataLoss: the file says that it has our schema. The statement must end before the
  /// database, and before the same SQL is prepared again.
  StatusOr<Statement> Prepare(std::string_view sql);

  /// The first column of the only row of a query without parameters.
  StatusOr<std::int64_t> QueryInt64(std::string_view sql);

  std::int64_t LastInsertRowId() const;

  /// Rows that the last statement inserted, updated or deleted.
  int Changes() const;

  bool writable() const;
  const std::string& path() const;
  /// "map store 'PATH'", or as the options say.
  const std::string& name() const;
  /// For another connection that only reads.
  const std::string& read_uri() const;

  /// For the other files of this folder.
  sqlite3* handle() const;

 private:
  struct State;
  explicit Database(std::unique_ptr<State> state);

  static StatusOr<Database> OpenUri(const std::string& path,
                                    const std::string& uri,
                                    const Options& options);
  Status SetUp(const Options& options);

  std::unique_ptr<State> state_;
};

}  // namespace shiftmap

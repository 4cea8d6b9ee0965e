// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/database.h"

#include <fcntl.h>
#include <linux/magic.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <optional>
#include <thread>
#include <utility>

#include "mapstore/sqlite/file_system.h"
#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/sqlite/sqlite_status.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

std::string NameOf(const std::string& path) { return fmt::format("map store '{}'", path); }

std::string UriOf(const std::string& path, const char* parameters) {
  // With a folder, ":memory:" is a file like others.
  std::string uri = path.starts_with('/') ? "file:" : "file:./";
  for (const char c : path) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                       c == '/' || c == '.' || c == '_' || c == '-' || c == '~';
    if (plain) {
      uri += c;
    } else {
      uri += fmt::format("%{:02X}", static_cast<unsigned char>(c));
    }
  }
  return uri + parameters;
}

// Files of /proc look regular, and reading them looks like a disk that fails.
bool IsOfProc(const std::string& path) {
  struct statfs info {};
  return statfs(path.c_str(), &info) == 0 && info.f_type == PROC_SUPER_MAGIC;
}

// The file as SQLite may not say it: SQLite reports a missing file, a missing folder and a folder
// all as "unable to open".
Status CheckFile(const std::string& path, Database::Mode mode) {
  if (path.empty()) return InvalidArgument("{}: expected the path of a file", NameOf(path));
  struct stat info {};
  if (stat(path.c_str(), &info) == 0) {
    if (S_ISREG(info.st_mode) && !IsOfProc(path)) {
      if (faccessat(AT_FDCWD, path.c_str(), R_OK, AT_EACCESS) == 0) return OkStatus();
      return Unavailable("{}: cannot be read: {}", NameOf(path), std::strerror(errno));
    }
    return FailedPrecondition("{}: not a map store: not a regular file", NameOf(path));
  }
  if (errno == EACCES) return Unavailable("{}: {}", NameOf(path), std::strerror(errno));
  if (mode != Database::Mode::kReadWriteCreate) {
    return NotFound("{}: does not exist", NameOf(path));
  }
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  std::error_code error;
  if (!folder.empty() && !std::filesystem::is_directory(folder, error)) {
    return NotFound("{}: its folder does not exist", NameOf(path));
  }
  return OkStatus();
}

// What the effective user may do with a file or folder that a store needs.
Status CheckAccess(const std::string& store, const std::string& path, int mode) {
  if (faccessat(AT_FDCWD, path.c_str(), mode, AT_EACCESS) == 0) return OkStatus();
  return Unavailable("{}: cannot be written: '{}': {}", NameOf(store), path, std::strerror(errno));
}

// True if nobody can write the file and no interrupted write waits to be rolled back: only then may
// SQLite read it without locks and journal.
bool IsImmutable(const std::string& path) {
  struct statvfs info {};
  if (statvfs(path.c_str(), &info) != 0 || (info.f_flag & ST_RDONLY) == 0) return false;
  for (const char* suffix : {"-journal", "-wal"}) {
    std::error_code error;
    const auto size = std::filesystem::file_size(path + suffix, error);
    if (!error && size > 0) return false;
  }
  return true;
}

// Far above what a store needs, far below what a hostile file could ask for.
void SetLimits(sqlite3* db) {
  sqlite3_limit(db, SQLITE_LIMIT_LENGTH, 256 << 20);
  sqlite3_limit(db, SQLITE_LIMIT_SQL_LENGTH, 100'000);
  sqlite3_limit(db, SQLITE_LIMIT_COLUMN, 100);
  sqlite3_limit(db, SQLITE_LIMIT_EXPR_DEPTH, 100);
  sqlite3_limit(db, SQLITE_LIMIT_COMPOUND_SELECT, 10);
  sqlite3_limit(db, SQLITE_LIMIT_FUNCTION_ARG, 50);
  sqlite3_limit(db, SQLITE_LIMIT_ATTACHED, 2);
  sqlite3_limit(db, SQLITE_LIMIT_LIKE_PATTERN_LENGTH, 100);
  sqlite3_limit(db, SQLITE_LIMIT_VARIABLE_NUMBER, 50);
  sqlite3_limit(db, SQLITE_LIMIT_TRIGGER_DEPTH, 1);
  sqlite3_limit(db, SQLITE_LIMIT_WORKER_THREADS, 0);
}

void SetDistrust(sqlite3* db) {
  sqlite3_db_config(db, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  sqlite3_db_config(db, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  sqlite3_db_config(db, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
  sqlite3_db_config(db, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
  sqlite3_db_config(db, SQLITE_DBCONFIG_ENABLE_FKEY, 1, nullptr);
}

// Waits for a lock that another connection holds, with growing pauses.
class LockWait {
 public:
  LockWait(std::chrono::milliseconds timeout, std::function<void()> on_wait)
      : timeout_(timeout), on_wait_(std::move(on_wait)) {}

  // SQLite's busy handler: `calls` counts from 0 for every wait. Returns 0 to give up.
  static int Wait(void* self, int calls) { return static_cast<LockWait*>(self)->Pause(calls); }

 private:
  static constexpr std::chrono::milliseconds kNoticeable{250};
  static constexpr std::chrono::milliseconds kLongestPause{10};

  int Pause(int calls) {
    const auto now = std::chrono::steady_clock::now();
    if (calls == 0) {
      begin_ = now;
      told_ = false;
    }
    const auto waited = now - begin_;
    if (waited >= timeout_) return 0;
    if (waited >= kNoticeable && !told_) {
      told_ = true;
      if (on_wait_) on_wait_();
    }
    const std::chrono::milliseconds pause(1 << std::min(calls, 10));
    std::this_thread::sleep_for(std::min(pause, kLongestPause));
    return 1;
  }

  std::chrono::milliseconds timeout_;
  std::function<void()> on_wait_;
  std::chrono::steady_clock::time_point begin_;
  bool told_ = false;
};

// Locks of network file systems do not hold.
Status CheckFileSystem(const std::string& path, const Database::Options& options) {
  const char* allowed = std::getenv("SHIFTMAP_ALLOW_NETWORK_FILE_SYSTEM");
  if (options.allow_network_file_system || (allowed != nullptr && *allowed == '1')) {
    return OkStatus();
  }
  const std::string type = NetworkFileSystemOf(path);
  if (type.empty()) return OkStatus();
  return FailedPrecondition(
      "{}: on a network file system ({}), where locks do not hold; "
      "SHIFTMAP_ALLOW_NETWORK_FILE_SYSTEM=1 opens it all the same",
      NameOf(path),
      type);
}

}  // namespace

struct Database::State {
  std::string path;
  std::string name;
  std::string read_uri;
  sqlite3* db = nullptr;
  std::optional<LockWait> lock_wait;
  std::map<std::string, sqlite3_stmt*, std::less<>> statements;

  State() = default;
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    for (const auto& [sql, statement] : statements) sqlite3_finalize(statement);
    sqlite3_close_v2(db);
  }
};

Database::Database(std::unique_ptr<State> state) : state_(std::move(state)) {}
Database::Database(Database&&) noexcept = default;
Database& Database::operator=(Database&&) noexcept = default;
Database::~Database() = default;

Status Database::CheckWritable(const std::string& path) {
  SHIFTMAP_RETURN_IF_ERROR(CheckFile(path, Mode::kReadWriteCreate));
  // SQLite keeps the journal beside the file that a link leads to.
  std::error_code error;
  const std::filesystem::path file = std::filesystem::weakly_canonical(path, error);
  const std::filesystem::path folder = (error ? std::filesystem::path(path) : file).parent_path();
  SHIFTMAP_RETURN_IF_ERROR(CheckAccess(path, folder.empty() ? "." : folder.string(), W_OK | X_OK));
  return access(path.c_str(), F_OK) == 0 ? CheckAccess(path, path, W_OK) : OkStatus();
}

StatusOr<Database> Database::Open(const std::string& path, const Options& options) {
  SHIFTMAP_RETURN_IF_ERROR(CheckFile(path, options.mode));
  SHIFTMAP_RETURN_IF_ERROR(CheckFileSystem(path, options));
  switch (options.mode) {
    case Mode::kReadWrite:
      return OpenUri(path, UriOf(path, "?mode=rw"), options);
    case Mode::kReadWriteCreate:
      return OpenUri(path, UriOf(path, "?mode=rwc"), options);
    case Mode::kReadOnly:
      break;
  }
  if (options.immutable) return OpenUri(path, UriOf(path, "?mode=ro&immutable=1"), options);
  StatusOr<Database> database = OpenUri(path, UriOf(path, "?mode=ro"), options);
  if (database.status().code() != StatusCode::kUnavailable) return database;
  if (IsImmutable(path)) return OpenUri(path, UriOf(path, "?mode=ro&immutable=1"), options);
  // A power cut may have left an interrupted write, which only a writer rolls back. A reader that
  // may write does so: nobody else might come.
  std::error_code error;
  if (std::filesystem::exists(path + "-journal", error)) {
    Options recover = options;
    recover.mode = Mode::kReadWrite;
    if (Open(path, recover).ok()) return OpenUri(path, UriOf(path, "?mode=ro"), options);
  }
  return database;
}

StatusOr<Database> Database::OpenInMemory() {
  Options options;
  options.mode = Mode::kReadWriteCreate;
  return OpenUri("(memory)", "file::memory:", options);
}

StatusOr<Database> Database::OpenUri(const std::string& path,
                                     const std::string& uri,
                                     const Options& options) {
  auto state = std::make_unique<State>();
  state->path = path;
  state->name = options.name.empty() ? NameOf(path) : options.name;
  state->read_uri = options.mode == Mode::kReadOnly ? uri : UriOf(path, "?mode=ro");
  const int access = options.mode == Mode::kReadOnly ? SQLITE_OPEN_READONLY
                     : options.mode == Mode::kReadWrite
                         ? SQLITE_OPEN_READWRITE
                         : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
  const int flags = access | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE;
  const int code = sqlite3_open_v2(uri.c_str(), &state->db, flags, nullptr);
  if (code != SQLITE_OK) return SqliteStatus(state->db, code, state->name);
  Database database(std::move(state));
  SHIFTMAP_RETURN_IF_ERROR(database.SetUp(options));
  return database;
}

Status Database::SetUp(const Options& options) {
  sqlite3* db = state_->db;
  SetLimits(db);
  SetDistrust(db);
  state_->lock_wait.emplace(options.busy_timeout, options.on_wait);
  sqlite3_busy_handler(db, LockWait::Wait, &*state_->lock_wait);
  SHIFTMAP_RETURN_IF_ERROR(SqliteStatus(db, AddRowChecksum(db), name()));
  SHIFTMAP_RETURN_IF_ERROR(Execute("PRAGMA cell_size_check=ON"));
  // Opening is lazy: this is the first read of the file, where damage and locks show.
  SHIFTMAP_RETURN_IF_ERROR(QueryInt64("PRAGMA schema_version").status());
  if (options.mode == Mode::kReadOnly) return OkStatus();
  if (!writable()) return Unavailable("{}: cannot be written: no permission", name());
  return Execute("PRAGMA journal_mode=DELETE; PRAGMA synchronous=EXTRA");
}

Status Database::Execute(const std::string& sql) {
  return SqliteStatus(
      state_->db, sqlite3_exec(state_->db, sql.c_str(), nullptr, nullptr, nullptr), name());
}

StatusOr<Statement> Database::Prepare(std::string_view sql) {
  const auto found = state_->statements.find(sql);
  if (found != state_->statements.end()) return Statement(found->second, state_->name);
  sqlite3_stmt* compiled = nullptr;
  const int code = sqlite3_prepare_v3(state_->db,
                                      sql.data(),
                                      static_cast<int>(sql.size()),
                                      SQLITE_PREPARE_PERSISTENT,
                                      &compiled,
                                      nullptr);
  if (code == SQLITE_ERROR) {
    return DataLoss("{}: damaged schema: {}", name(), sqlite3_errmsg(state_->db));
  }
  if (code != SQLITE_OK) return SqliteStatus(state_->db, code, name());
  state_->statements.emplace(sql, compiled);
  return Statement(compiled, state_->name);
}

StatusOr<std::int64_t> Database::QueryInt64(std::string_view sql) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, Prepare(sql));
  SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
  if (!row) return Internal("{}: no row from: {}", name(), sql);
  return query.Int64(0);
}

std::int64_t Database::LastInsertRowId() const { return sqlite3_last_insert_rowid(state_->db); }
int Database::Changes() const { return sqlite3_changes(state_->db); }
bool Database::writable() const { return sqlite3_db_readonly(state_->db, "main") == 0; }
const std::string& Database::path() const { return state_->path; }
const std::string& Database::name() const { return state_->name; }
sqlite3* Database::handle() const { return state_->db; }
const std::string& Database::read_uri() const { return state_->read_uri; }

}  // namespace shiftmap

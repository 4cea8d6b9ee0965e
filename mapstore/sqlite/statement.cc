// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/statement.h"

#include <sqlite3.h>

#include "mapstore/sqlite/sqlite_status.h"
#include "proto/core/check.h"

namespace shiftmap {

Statement::Statement(sqlite3_stmt* statement, const std::string& name)
    : statement_(statement), name_(&name) {
  SHIFTMAP_CHECK(sqlite3_stmt_busy(statement_) == 0, "in use: {}", sqlite3_sql(statement_));
}

Statement::Statement(Statement&& other) noexcept
    : statement_(std::exchange(other.statement_, nullptr)),
      name_(other.name_),
      error_(other.error_) {}

Statement::~Statement() {
  if (statement_ == nullptr) return;
  sqlite3_reset(statement_);
  sqlite3_clear_bindings(statement_);
}

void Statement::Reset() {
  sqlite3_reset(statement_);
  error_ = SQLITE_OK;
}

void Statement::Note(int code) {
  if (error_ == SQLITE_OK) error_ = code;
}

void Statement::BindAt(int index, std::int64_t value) {
  Note(sqlite3_bind_int64(statement_, index, value));
}

void Statement::BindAt(int index, double value) {
  Note(sqlite3_bind_double(statement_, index, value));
}

void Statement::BindAt(int index, std::string_view text) {
  // A null pointer would bind NULL instead of the empty text.
  const char* bytes = text.empty() ? "" : text.data();
  Note(sqlite3_bind_text64(statement_, index, bytes, text.size(), SQLITE_STATIC, SQLITE_UTF8));
}

void Statement::BindAt(int index, BlobView blob) {
  const char* bytes = blob.bytes.empty() ? "" : blob.bytes.data();
  Note(sqlite3_bind_blob64(statement_, index, bytes, blob.bytes.size(), SQLITE_STATIC));
}

void Statement::BindAt(int index, const std::optional<std::int64_t>& value) {
  Note(value ? sqlite3_bind_int64(statement_, index, *value)
             : sqlite3_bind_null(statement_, index));
}

StatusOr<bool> Statement::Step() {
  const int code = error_ != SQLITE_OK ? error_ : sqlite3_step(statement_);
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  return SqliteStatus(sqlite3_db_handle(statement_), code, *name_);
}

Status Statement::Execute() {
  SHIFTMAP_ASSIGN_OR_RETURN(const bool row, Step());
  SHIFTMAP_CHECK(!row, "returned a row: {}", sqlite3_sql(statement_));
  sqlite3_reset(statement_);
  return OkStatus();
}

int Statement::Columns() const { return sqlite3_column_count(statement_); }

ValueType Statement::Type(int column) const {
  switch (sqlite3_column_type(statement_, column)) {
    case SQLITE_INTEGER:
      return ValueType::kInteger;
    case SQLITE_FLOAT:
      return ValueType::kReal;
    case SQLITE_TEXT:
      return ValueType::kText;
    case SQLITE_BLOB:
      return ValueType::kBlob;
    default:
      return ValueType::kNull;
  }
}

bool Statement::IsNull(int column) const { return Type(column) == ValueType::kNull; }

std::int64_t Statement::Int64(int column) const { return sqlite3_column_int64(statement_, column); }

double Statement::Double(int column) const { return sqlite3_column_double(statement_, column); }

std::string Statement::Text(int column) const { return std::string(Blob(column)); }

std::string_view Statement::Blob(int column) const {
  const void* bytes = sqlite3_column_blob(statement_, column);
  const auto size = static_cast<std::size_t>(sqlite3_column_bytes(statement_, column));
  return {static_cast<const char*>(bytes), bytes == nullptr ? 0 : size};
}

}  // namespace shiftmap

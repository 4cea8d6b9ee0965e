// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>

#include "proto/core/status.h"

struct sqlite3_stmt;

namespace shiftmap {

/// What SQLite stores in a column of a row.
enum class ValueType { kNull, kInteger, kReal, kText, kBlob };

/// One use of a compiled statement of a Database: bind, step through the rows, read columns. The
/// end of the object resets it for the next use.
///
///     SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare("SELECT a FROM t WHERE b =
///     ?1")); query.Bind(b); for (;;) {
///       SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
///       if (!row) break;
///       Use(query.Int64(0));
///     }
///
/// Ownership: bound text is not copied; it must live until the next Bind, or the end of the object.
class Statement {
 public:
  Statement(sqlite3_stmt* statement, const std::string& name);
  Statement(Statement&& other) noexcept;
  Statement& operator=(Statement&&) = delete;
  ~Statement();

  /// Binds all parameters in order, from ?1 on, and resets the statement to its start. A parameter
  /// that SQLite refuses makes the next Step fail.
  template <typename... Values>
  void Bind(Values&&... values) {
    static_assert((!std::is_same_v<Values, std::string> && ...),
                  "a text that ends before the step");
    Reset();
    int index = 0;
    (BindAt(++index, values), ...);
  }

  /// Goes to the next row; false after the last one.
  StatusOr<bool> Step();

  /// Runs a statement that returns no rows.
  Status Execute();

  /// Columns of the current row, from 0; text is valid until the next Step.
  int Columns() const;
  ValueType Type(int column) const;
  bool IsNull(int column) const;
  std::int64_t Int64(int column) const;
  double Double(int column) const;
  std::string Text(int column) const;
  std::string_view Blob(int column) const;

 private:
  void Reset();
  void BindAt(int index, std::int64_t value);
  void BindAt(int index, int value) { BindAt(index, std::int64_t{value}); }
  void BindAt(int index, double value);
  void BindAt(int index, std::string_view text);
  void BindAt(int index, const std::string& text) { BindAt(index, std::string_view(text)); }
  void BindAt(int index, const char* text) { BindAt(index, std::string_view(text)); }
  void BindAt(int index, struct BlobView blob);
  void BindAt(int index, const std::optional<std::int64_t>& value);
  void Note(int code);

  sqlite3_stmt* statement_;
  const std::string* name_;
  int error_ = 0;  // The first result code of a Bind that failed.
};

/// Bytes to bind as a BLOB.
struct BlobView {
  std::string_view bytes;
};

}  // namespace shiftmap

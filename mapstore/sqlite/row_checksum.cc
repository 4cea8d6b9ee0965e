// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/row_checksum.h"

#include <sqlite3.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cstdint>

namespace shiftmap {
namespace {

void AppendBits(std::uint64_t bits, std::string* bytes) {
  for (int shift = 56; shift >= 0; shift -= 8) bytes->push_back(static_cast<char>(bits >> shift));
}

void AppendValue(sqlite3_value* value, std::string* bytes) {
  const int type = sqlite3_value_type(value);
  bytes->push_back(static_cast<char>(type));
  if (type == SQLITE_INTEGER) {
    AppendBits(static_cast<std::uint64_t>(sqlite3_value_int64(value)), bytes);
  } else if (type == SQLITE_FLOAT) {
    // SQLite keeps -0 as 0.
    AppendBits(std::bit_cast<std::uint64_t>(sqlite3_value_double(value) + 0.0), bytes);
  } else if (type != SQLITE_NULL) {
    const void* const blob = sqlite3_value_blob(value);
    const auto size = static_cast<std::size_t>(sqlite3_value_bytes(value));
    AppendBits(size, bytes);
    if (size > 0) bytes->append(static_cast<const char*>(blob), size);
  }
}

void RowChecksum(sqlite3_context* context, int count, sqlite3_value** values) {
  thread_local std::string bytes;  // Kept for its memory.
  bytes.clear();
  for (int i = 0; i < count; ++i) AppendValue(values[i], &bytes);
  const uLong crc = crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size());
  sqlite3_result_int(context, static_cast<std::int32_t>(crc));
}

}  // namespace

int AddRowChecksum(sqlite3* db) {
  return sqlite3_create_function_v2(db,
                                    "row_checksum",
                                    -1,
                                    SQLITE_UTF8 | SQLITE_DETERMINISTIC | SQLITE_DIRECTONLY,
                                    nullptr,
                                    RowChecksum,
                                    nullptr,
                                    nullptr,
                                    nullptr);
}

std::string InsertRowSql(std::string_view table, std::string_view columns) {
  std::string values;
  for (std::ptrdiff_t i = 1; i <= 1 + std::ranges::count(columns, ','); ++i) {
    values += fmt::format("{}?{}", i > 1 ? ", " : "", i);
  }
  return fmt::format("INSERT INTO {} ({}, checksum) VALUES ({}, row_checksum({}))",
                     table,
                     columns,
                     values,
                     values);
}

StatusOr<std::string> ChecksumColumns(Database& database, std::string_view table) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT name FROM pragma_table_info(?1, 'main') "
                       "WHERE name NOT IN ('checksum', 'rows_since_checkpoint') AND NOT (pk = 1 "
                       "AND (SELECT count(*) FROM pragma_table_info(?1, 'main') WHERE pk > 0) = 1) "
                       "ORDER BY cid"));
  query.Bind(table);
  std::string columns;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return columns;
    columns += (columns.empty() ? "" : ", ") + query.Text(0);
  }
}

Status SetChecksums(Database& database, std::string_view table, std::string_view where) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string columns, ChecksumColumns(database, table));
  return database.Execute(fmt::format(
      "UPDATE main.{} SET checksum = row_checksum({}) WHERE {}", table, columns, where));
}

}  // namespace shiftmap

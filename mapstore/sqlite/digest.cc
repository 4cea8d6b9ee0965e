// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/digest.h"

#include <bit>
#include <cstdint>
#include <vector>

#include "mapstore/map/sha256.h"

namespace shiftmap {
namespace {

void Add(Sha256& hash, std::int64_t value) {
  char bytes[8];
  const auto bits = static_cast<std::uint64_t>(value);
  for (int i = 0; i < 8; ++i) bytes[i] = static_cast<char>(bits >> (56 - 8 * i));
  hash.Update({bytes, sizeof bytes});
}

void Add(Sha256& hash, std::string_view bytes) {
  Add(hash, static_cast<std::int64_t>(bytes.size()));
  hash.Update(bytes);
}

void AddValue(Sha256& hash, const Statement& row, int column) {
  const ValueType type = row.Type(column);
  Add(hash, static_cast<std::int64_t>(type));
  switch (type) {
    case ValueType::kNull:
      return;
    case ValueType::kInteger:
      return Add(hash, row.Int64(column));
    case ValueType::kReal:
      return Add(hash, std::bit_cast<std::int64_t>(row.Double(column)));
    case ValueType::kText:
    case ValueType::kBlob:
      return Add(hash, row.Blob(column));
  }
}

StatusOr<std::vector<std::string>> ReadTexts(Database& database,
                                             std::string_view sql,
                                             const std::string& argument) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare(sql));
  if (argument.empty()) {
    query.Bind();
  } else {
    query.Bind(argument);
  }
  std::vector<std::string> texts;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return texts;
    texts.push_back(query.Text(0));
  }
}

std::string Quoted(const std::string& name) {
  std::string quoted = "\"";
  for (const char c : name) {
    if (c == '"') quoted += c;
    quoted += c;
  }
  return quoted + '"';
}

}  // namespace

StatusOr<std::string> DigestRows(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::vector<std::string> tables,
      ReadTexts(database,
                "SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite_%' "
                "ORDER BY name",
                ""));
  Sha256 hash;
  for (const std::string& table : tables) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        const std::vector<std::string> keys,
        ReadTexts(
            database, "SELECT name FROM pragma_table_info(?1) WHERE pk > 0 ORDER BY pk", table));
    std::string order;
    for (const std::string& key : keys) order += (order.empty() ? "" : ", ") + Quoted(key);
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement rows,
        database.Prepare(fmt::format(
            "SELECT * FROM {} ORDER BY {}", Quoted(table), order.empty() ? "1" : order)));
    rows.Bind();
    Add(hash, table);
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
      Add(hash, std::int64_t{row});
      if (!row) break;
      for (int column = 0; column < rows.Columns(); ++column) AddValue(hash, rows, column);
    }
  }
  return hash.HexDigest();
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/maintenance/verify.h"

#include <map>
#include <tuple>

#include "mapstore/maintenance/verify_rows.h"
#include "mapstore/schema/store_file.h"
#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/sqlite/transaction.h"

namespace shiftmap {
namespace {

// (type, name) -> SQL of everything in a schema.
using SchemaObjects = std::map<std::tuple<std::string, std::string>, std::string>;

StatusOr<SchemaObjects> ReadSchema(Database& database) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query, database.Prepare("SELECT type, name, coalesce(sql, '') FROM sqlite_schema"));
  query.Bind();
  SchemaObjects objects;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return objects;
    objects[{query.Text(0), query.Text(1)}] = query.Text(2);
  }
}

Status VerifySchema(Database& database, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(Database fresh, Database::OpenInMemory());
  SHIFTMAP_RETURN_IF_ERROR(Migrate(fresh, 0));
  SHIFTMAP_ASSIGN_OR_RETURN(SchemaObjects expected, ReadSchema(fresh));
  SHIFTMAP_ASSIGN_OR_RETURN(const SchemaObjects got, ReadSchema(database));
  for (const auto& [key, sql] : got) {
    const auto& [type, name] = key;
    // What SQLite keeps for itself, as after ANALYZE.
    if (name.rfind("sqlite_stat", 0) == 0) continue;
    const auto found = expected.find(key);
    if (found == expected.end()) {
      defects->Add("sqlite_schema", name, type + " that a store does not have");
      continue;
    }
    if (found->second != sql) {
      defects->Add("sqlite_schema", name, type + " is not as in a fresh store");
    }
    expected.erase(found);
  }
  for (const auto& [key, sql] : expected) {
    defects->Add("sqlite_schema", std::get<1>(key), std::get<0>(key) + " is missing");
  }
  return OkStatus();
}

Status VerifyPages(Database& database, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare("PRAGMA integrity_check"));
  query.Bind();
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return OkStatus();
    if (query.Text(0) != "ok") defects->Add("", "", query.Text(0));
  }
}

Status VerifyReferences(Database& database, DefectList* defects) {
  SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare("PRAGMA foreign_key_check"));
  query.Bind();
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return OkStatus();
    defects->Add(query.Text(0),
                 query.IsNull(1) ? "" : fmt::format("row {}", query.Int64(1)),
                 "refers to a row of " + query.Text(2) + " that is not there");
  }
}

// SQL of a row's key, for people.
StatusOr<std::string> KeySql(Database& database, std::string_view table) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT name FROM pragma_table_info(?1) WHERE pk > 0 ORDER BY pk"));
  query.Bind(table);
  std::string sql;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return sql;
    sql += fmt::format(
        "{}'{} ' || quote({})", sql.empty() ? "" : " || ', ' || ", query.Text(0), query.Text(0));
  }
}

}  // namespace

Status VerifyChecksums(Database& database, DefectList* defects) {
  for (const char* const table : kChecksumTables) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string columns, ChecksumColumns(database, table));
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string key, KeySql(database, table));
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement rows,
        database.Prepare(fmt::format(
            "SELECT {} FROM {} WHERE checksum <> row_checksum({})", key, table, columns)));
    rows.Bind();
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
      if (!row) break;
      defects->Add(table, rows.Text(0), "its checksum is not that of its values");
    }
  }
  return OkStatus();
}

Status VerifyFile(Database& database, DefectList* defects) {
  SHIFTMAP_RETURN_IF_ERROR(VerifyPages(database, defects));
  SHIFTMAP_RETURN_IF_ERROR(VerifySchema(database, defects));
  return VerifyReferences(database, defects);
}

StatusOr<VerifyResult> VerifyStore(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, OpenStoreFile(path, {}));
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction,
                            Transaction::Begin(database, Transaction::Kind::kRead));
  VerifyResult result;
  DefectList defects(&result);
  for (const auto part : {VerifyFile,
                          VerifyChecksums,
                          VerifyVersions,
                          VerifyEdits,
                          VerifyLedger,
                          VerifyCheckpoints,
                          FindFutureStamps}) {
    const Status status = part(database, &defects);
    if (status.ok()) continue;
    // Damage that keeps a part from going on is a defect like others; a lost disk is not.
    if (status.code() != StatusCode::kDataLoss) return status;
    defects.Add("", "", Message(status));
  }
  return result;
}

}  // namespace shiftmap

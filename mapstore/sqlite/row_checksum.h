// SPDX-License-Identifier: Apache-2.0
//
// What a disk or a copy changed in a stored value must show. A row has, in its column `checksum`,
// the checksum of its other columns in the order of the table, but for a key of one column and
// area.rows_since_checkpoint. Who writes a row writes it too, verification compares it.
#pragma once

#include <array>
#include <string>
#include <string_view>

#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

struct sqlite3;

namespace shiftmap {

/// The tables with a column `checksum`. The others hold what a version's content hash is of.
inline constexpr std::array kChecksumTables = {"area",
                                               "audit",
                                               "decision",
                                               "exclusion",
                                               "ledger_checkpoint",
                                               "ledger_summary",
                                               "map_edit",
                                               "mapped_evidence",
                                               "mapped_report",
                                               "mapped_visibility",
                                               "run",
                                               "shift_report",
                                               "sighting",
                                               "split_run",
                                               "stated_probability",
                                               "vehicle_calibration",
                                               "version",
                                               "version_edit",
                                               "version_run",
                                               "visit_evidence"};

/// Gives a connection the SQL function `row_checksum(value, ...)`: the CRC-32 of types and values,
/// signed. Returns a result code of SQLite.
int AddRowChecksum(sqlite3* db);

/// `INSERT INTO table (columns, checksum) VALUES (?1, ..., row_checksum(?1, ...))`.
/// @param columns  Those that the checksum is of, in their order, separated by ", ".
std::string InsertRowSql(std::string_view table, std::string_view columns);

/// The columns that the checksum of a table of kChecksumTables is of, separated by ", ".
StatusOr<std::string> ChecksumColumns(Database& database, std::string_view table);

/// Sets the checksums of rows that were changed, or added in another way.
/// @param where  Which rows: SQL without parameters.
Status SetChecksums(Database& database, std::string_view table, std::string_view where = "1");

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sqlite3.h>

#include <string>

#include "mapstore/map/evidence.h"
#include "proto/core/check.h"

namespace shiftmap::testing {

/// The rows of a report in one durable transaction, without a store around them.
class PlainSqlite {
 public:
  explicit PlainSqlite(const std::string& path) {
    SHIFTMAP_CHECK(sqlite3_open(path.c_str(), &db_) == SQLITE_OK, "cannot open {}", path);
    Run("PRAGMA journal_mode=DELETE; PRAGMA synchronous=EXTRA;"
        "CREATE TABLE visit_evidence (area_id INTEGER NOT NULL, begin_ns INTEGER NOT NULL, "
        "end_ns INTEGER NOT NULL, report_id INTEGER NOT NULL, signature TEXT NOT NULL, "
        "version_id INTEGER NOT NULL, observation_count INTEGER NOT NULL, "
        "log_likelihoods BLOB NOT NULL, "
        "PRIMARY KEY (area_id, begin_ns, end_ns, report_id, signature)) STRICT, WITHOUT ROWID");
    SHIFTMAP_CHECK(
        sqlite3_prepare_v2(
            db_, "INSERT INTO visit_evidence VALUES (?,?,?,?,?,?,?,?)", -1, &insert_, nullptr) ==
            SQLITE_OK,
        "{}",
        sqlite3_errmsg(db_));
  }
  PlainSqlite(const PlainSqlite&) = delete;
  PlainSqlite& operator=(const PlainSqlite&) = delete;
  ~PlainSqlite() {
    sqlite3_finalize(insert_);
    sqlite3_close(db_);
  }

  void Insert(const ShiftReport& report, int report_id) {
    Run("BEGIN IMMEDIATE");
    for (const VisitEvidence& evidence : report.evidence) {
      const std::string& signature = evidence.signature.text();
      const std::string blob(16 * evidence.modes.size(), 'x');
      sqlite3_bind_int64(insert_, 1, 1);
      sqlite3_bind_int64(insert_, 2, ToNanoseconds(evidence.begin));
      sqlite3_bind_int64(insert_, 3, ToNanoseconds(evidence.end));
      sqlite3_bind_int64(insert_, 4, report_id);
      sqlite3_bind_text(
          insert_, 5, signature.data(), static_cast<int>(signature.size()), SQLITE_STATIC);
      sqlite3_bind_int64(insert_, 6, 1);
      sqlite3_bind_int64(insert_, 7, evidence.observations);
      sqlite3_bind_blob(insert_, 8, blob.data(), static_cast<int>(blob.size()), SQLITE_STATIC);
      SHIFTMAP_CHECK(sqlite3_step(insert_) == SQLITE_DONE, "{}", sqlite3_errmsg(db_));
      sqlite3_reset(insert_);
    }
    Run("COMMIT");
  }

 private:
  void Run(const char* sql) {
    SHIFTMAP_CHECK(
        sqlite3_exec(db_, sql, nullptr, nullptr, nullptr) == SQLITE_OK, "{}", sqlite3_errmsg(db_));
  }

  sqlite3* db_ = nullptr;
  sqlite3_stmt* insert_ = nullptr;
};

}  // namespace shiftmap::testing

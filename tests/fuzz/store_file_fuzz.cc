// SPDX-License-Identifier: Apache-2.0
//
// Opens files that are not, or no longer, a good map store, and reads all there is to read, or
// returns a report, exports and rolls back. The first byte of the input says what the rest is: a
// whole file; patches of the bytes of a valid store; or values for its cells, so that SQLite finds
// nothing wrong and the store must. And whether the file is read or written.
#include <sqlite3.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "proto/core/check.h"
#include "tests/fault/fault_plan.h"
#include "tests/fault/store_steps.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

struct Column {
  std::string table;
  std::string name;
};

// A valid store with versions, reports and checkpoints, its columns, and a snapshot of it.
struct Base {
  Base() {
    const TempDir dir;
    const StoreFiles files(dir.path());
    for (const StoreStep& step : StoreLife()) {
      if (step.name == "Compact") break;
      const Status status = step.run(files);
      SHIFTMAP_CHECK(status.ok(), "{}: {}", step.name, Message(status));
    }
    bytes = ReadFile(files.store);
    snapshot = ReadFile(files.snapshot);
    sqlite3* db = nullptr;
    sqlite3_open(files.store.c_str(), &db);
    const auto append = [](void* into, int, char** values, char**) {
      static_cast<std::vector<Column>*>(into)->push_back({values[0], values[1]});
      return 0;
    };
    const char* sql =
        "SELECT t.name, c.name FROM pragma_table_list t JOIN pragma_table_info(t.name) c "
        "WHERE t.schema = 'main' AND t.name NOT LIKE 'sqlite_%' ORDER BY t.name, c.cid";
    SHIFTMAP_CHECK(sqlite3_exec(db, sql, append, &columns, nullptr) == SQLITE_OK, "{}", sql);
    sqlite3_close(db);
  }

  std::string bytes;
  std::string snapshot;
  std::vector<Column> columns;
};

std::string PatchBytes(std::string bytes, FuzzInput input) {
  while (!input.empty()) {
    const std::size_t offset = input.Take(3) % bytes.size();
    const std::string_view patch = input.TakeBytes(1 + input.Take(1) % 64);
    bytes.replace(offset, std::min(patch.size(), bytes.size() - offset), patch);
  }
  return bytes;
}

// Gives all cells of a column that are equal to one of them another value.
void EditCells(sqlite3* db, const Column& column, FuzzInput* input) {
  const auto row = static_cast<int>(input->Take(1));
  const std::uint64_t kind = input->Take(1) % 4;
  const std::string value = kind == 3 ? fmt::format(
                                            "CAST(substr({0}, 1, ?2) || ?1 || "
                                            "substr({0}, ?2 + 1 + length(?1)) AS BLOB)",
                                            column.name)
                                      : "?1";
  const std::string sql = fmt::format(
      "UPDATE OR IGNORE \"{0}\" SET {1} = {2} WHERE {1} IS "
      "(SELECT {1} FROM \"{0}\" LIMIT 1 OFFSET ?3 % max(1, (SELECT count(*) FROM \"{0}\")))",
      column.table,
      column.name,
      value);
  sqlite3_stmt* statement = nullptr;
  SHIFTMAP_CHECK(sqlite3_prepare_v2(db, sql.c_str(), -1, &statement, nullptr) == SQLITE_OK,
                 "{}: {}",
                 sql,
                 sqlite3_errmsg(db));
  if (kind == 0) {
    sqlite3_bind_int64(statement, 1, static_cast<sqlite3_int64>(input->Take(8)));
  } else if (kind == 1) {
    sqlite3_bind_double(statement, 1, std::bit_cast<double>(input->Take(8)));
  } else if (kind == 2) {
    const std::string_view bytes = input->TakeBytes(input->Take(1));
    sqlite3_bind_text(statement, 1, bytes.data(), static_cast<int>(bytes.size()), SQLITE_TRANSIENT);
  } else {
    const auto offset = static_cast<int>(input->Take(1)) * 8;
    const std::string_view bytes = input->TakeBytes(8);
    sqlite3_bind_blob(statement, 1, bytes.data(), static_cast<int>(bytes.size()), SQLITE_TRANSIENT);
    sqlite3_bind_int(statement, 2, offset);
  }
  sqlite3_bind_int(statement, 3, row);
  sqlite3_step(statement);  // A value of the wrong type is refused.
  sqlite3_finalize(statement);
}

void EditFile(const std::string& path, const Base& base, FuzzInput input) {
  sqlite3* db = nullptr;
  sqlite3_open(path.c_str(), &db);
  sqlite3_exec(db,
               "PRAGMA ignore_check_constraints=ON; PRAGMA foreign_keys=OFF; "
               "PRAGMA journal_mode=OFF; BEGIN",
               nullptr,
               nullptr,
               nullptr);
  for (int edits = 0; edits < 16 && !input.empty(); ++edits) {
    EditCells(db, base.columns[input.Take(1) % base.columns.size()], &input);
  }
  sqlite3_exec(db, "COMMIT", nullptr, nullptr, nullptr);
  sqlite3_close(db);
}

void ReadAll(const std::string& path) {
  StatusOr<MapStore> store = MapStore::Open(path, MapStore::Access::kReadOnly);
  if (!store.ok()) return;
  store->AuditLog().status().IgnoreError();
  const auto areas = store->Areas();
  if (!areas.ok()) return;
  for (const AreaSummary& area : *areas) {
    store->LoadAt(area.area).status().IgnoreError();
    store->LoadAt(area.area, {}, StampFromNanoseconds(0)).status().IgnoreError();
    store->Sightings(area.area).status().IgnoreError();
    store->Reports(area.area).status().IgnoreError();
    const auto versions = store->Versions(area.area);
    if (!versions.ok()) continue;
    for (const VersionSummary& version : *versions) {
      store->LoadProvenance(area.area, version.version).status().IgnoreError();
      const auto map = store->LoadVersion(area.area, version.version);
      if (!map.ok()) continue;
      SHIFTMAP_CHECK(ValidateMapContent(map->content()).ok(), "an invalid map was loaded");
      const auto now = store->LoadAt(area.area, version.version);
      if (!now.ok()) continue;
      const Status valid = ValidateMapContent(now->content());
      SHIFTMAP_CHECK(valid.ok(), "an invalid map was derived: {}", Message(valid));
    }
  }
}

void WriteSome(const std::string& path, const std::string& snapshot) {
  StatusOr<MapStore> store = MapStore::Open(path, MapStore::Access::kReadWrite);
  if (!store.ok()) return;
  const auto map = store->LoadAt("mine");
  if (!map.ok()) return;
  store->Return(SmallReport(*map, 100)).status().IgnoreError();
  store->ExportSnapshot("mine", snapshot).status().IgnoreError();
  store->Rollback("mine").status().IgnoreError();
}

void Run(std::string_view bytes) {
  static const Base base;
  static const TempDir dir;
  const StoreFiles files(dir.path());
  std::filesystem::remove(files.store + "-journal");
  FuzzInput input(bytes);
  const std::uint64_t choice = input.Take(1);
  const std::string& whole = (choice & 8U) != 0 ? base.snapshot : base.bytes;
  switch (choice % 4) {
    case 0:
      WriteFile(files.store, std::string(input.rest()));
      break;
    case 1:
      WriteFile(files.store, PatchBytes(whole, input));
      break;
    default:
      WriteFile(files.store, whole);
      EditFile(files.store, base, input);
  }
  // One or the other: each reads much of the store.
  if ((choice & 4U) != 0) {
    WriteSome(files.store, files.snapshot);
  } else {
    ReadAll(files.store);
  }
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  const auto byte = [](std::size_t value) { return static_cast<char>(value); };
  std::mt19937_64 random(1);
  std::vector<std::string> seeds = {"", "\2", std::string("\0SQLite format 3", 16)};
  seeds.back() += std::string(200, '\0');
  for (std::size_t i = 0; i < 100; ++i) {
    std::string patch(1, "\x01\x05\x09"[i % 3]);
    for (std::size_t patches = 0; patches <= i % 3; ++patches) {
      patch += byte(random() % 4);
      for (int k = 0; k < 11; ++k) patch += byte(random() % 256);
    }
    seeds.push_back(patch);
  }
  // One value of every kind for every column.
  for (std::size_t column = 0; column < 160; ++column) {
    for (std::size_t kind = 0; kind < 4; ++kind) {
      std::string edit{"\x02\x06\x0a"[random() % 3], byte(column), byte(random() % 8), byte(kind)};
      if (kind == 2) edit += '\x08';
      if (kind == 3) edit += byte(random() % 4);
      for (int i = 0; i < 8; ++i) edit += i < 6 && kind == 0 ? '\0' : byte(random() % 256);
      seeds.push_back(edit);
    }
  }
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  // Nothing fails, and nobody waits for the disk.
  FaultPlan none(Fault::kAnyOnce, 1'000'000'000);
  const ObservedFiles observed(none);
  Run(bytes);
}

}  // namespace shiftmap::testing

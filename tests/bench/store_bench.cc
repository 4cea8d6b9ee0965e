// SPDX-License-Identifier: Apache-2.0
//
// How the store scales: committing and loading maps of n groups, returning reports of n visits
// beside plain SQLite doing the same inserts.
#include <benchmark/benchmark.h>
#include <sqlite3.h>

#include <chrono>
#include <optional>
#include <random>
#include <string>

#include "mapstore/map_store.h"
#include "proto/core/check.h"
#include "tests/support/random_map.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

// A store with one area 'a' of `groups` groups with 3 modes each.
struct World {
  explicit World(int groups) {
    RandomMapOptions options;
    options.groups = groups;
    options.max_modes = 5;
    std::mt19937_64 random(1);
    content = RandomContent(random, options);
    StatusOr<MapStore> opened =
        MapStore::Open(dir.File("a.db"), MapStore::Access::kReadWriteCreate);
    SHIFTMAP_CHECK(opened.ok(), "{}", Message(opened.status()));
    store.emplace(*std::move(opened));
    Commit();
  }

  void Commit() {
    const StatusOr<CommitResult> result = store->Commit("a", content, {}, {});
    SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
    version = *result;
  }

  // A report with one visit of each of the first `visits` groups, again and again.
  ShiftReport Report(int visits) {
    ShiftReport report;
    report.uuid = fmt::format("{:08x}-0000-4000-8000-000000000000", reports++);
    report.vehicle = "v";
    report.software = "store_bench";
    report.area = "a";
    report.version = version.version;
    report.content_hash = version.content_hash;
    std::mt19937_64 random(static_cast<std::uint64_t>(reports));
    Stamp begin = content.stamp + std::chrono::hours(reports);
    report.begin = begin;
    for (int i = 0; i < visits; ++i) {
      const auto group = static_cast<std::size_t>(i) % content.groups.size();
      begin += std::chrono::seconds(1);
      report.evidence.push_back(RandomEvidence(random, content.groups[group], begin, begin));
    }
    report.end = begin;
    return report;
  }

  void Return(const ShiftReport& report) {
    const StatusOr<ReturnResult> result = store->Return(report);
    SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
  }

  TempDir dir;
  MapContent content;
  std::optional<MapStore> store;
  CommitResult version;
  int reports = 0;
};

void BM_Commit(benchmark::State& state) {
  World world(static_cast<int>(state.range(0)));
  for (auto _ : state) world.Commit();
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(BM_Commit)->Arg(100)->Arg(1000)->Arg(10000)->Unit(benchmark::kMillisecond);

void BM_LoadVersion(benchmark::State& state) {
  World world(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(world.store->LoadVersion("a", world.version.version));
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(BM_LoadVersion)->Arg(100)->Arg(1000)->Arg(10000)->Unit(benchmark::kMillisecond);

void BM_Return(benchmark::State& state) {
  World world(1000);
  for (auto _ : state) {
    state.PauseTiming();
    const ShiftReport report = world.Report(static_cast<int>(state.range(0)));
    state.ResumeTiming();
    world.Return(report);
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(BM_Return)->Arg(10)->Arg(100)->Arg(1000)->Unit(benchmark::kMillisecond);

// The rows of a report in one durable transaction, without a store around them.
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

void BM_RawInserts(benchmark::State& state) {
  World world(1000);
  PlainSqlite plain(world.dir.File("plain.db"));
  for (auto _ : state) {
    state.PauseTiming();
    const ShiftReport report = world.Report(static_cast<int>(state.range(0)));
    state.ResumeTiming();
    plain.Insert(report, world.reports);
  }
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(BM_RawInserts)->Arg(10)->Arg(100)->Arg(1000)->Unit(benchmark::kMillisecond);

void BM_ExportSnapshot(benchmark::State& state) {
  World world(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(world.store->ExportSnapshot("a", world.dir.File("s.db")));
  }
}
BENCHMARK(BM_ExportSnapshot)->Arg(1000)->Arg(10000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace shiftmap::testing

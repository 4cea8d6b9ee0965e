// SPDX-License-Identifier: Apache-2.0
//
// How the store scales: committing and loading maps of n groups, returning reports of n visits, and
// deriving probabilities from a ledger.
#include <benchmark/benchmark.h>

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

// A store with one area 'a' of `groups` groups with 3 modes on average.
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
    report.uuid = "bench-" + std::to_string(reports++);
    report.area = "a";
    report.version = version.version;
    report.content_hash = version.content_hash;
    std::mt19937_64 random(static_cast<std::uint64_t>(reports));
    Stamp begin = content.stamp + std::chrono::hours(reports);
    for (int i = 0; i < visits; ++i) {
      const auto group = static_cast<std::size_t>(i) % content.groups.size();
      begin += std::chrono::seconds(1);
      report.evidence.push_back(RandomEvidence(random, content.groups[group], begin, begin));
    }
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

// A ledger of `range` evidence rows.
void BM_LoadAt(benchmark::State& state) {
  constexpr int kGroups = 1000;
  World world(kGroups);
  for (std::int64_t rows = 0; rows < state.range(0); rows += kGroups) {
    world.Return(world.Report(kGroups));
  }
  for (auto _ : state) benchmark::DoNotOptimize(world.store->LoadAt("a"));
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(BM_LoadAt)->Arg(0)->Arg(10'000)->Arg(100'000)->Unit(benchmark::kMillisecond);

void BM_ExportSnapshot(benchmark::State& state) {
  World world(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(world.store->ExportSnapshot("a", world.dir.File("s.db")));
  }
}
BENCHMARK(BM_ExportSnapshot)->Arg(1000)->Arg(10000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
//
// How the store scales: committing and loading maps of n groups, returning reports of n visits
// beside plain SQLite doing the same inserts.
#include <benchmark/benchmark.h>

#include "tests/bench/plain_sqlite.h"
#include "tests/bench/store_world.h"

namespace shiftmap::testing {
namespace {

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

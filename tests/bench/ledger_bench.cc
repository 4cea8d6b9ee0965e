// SPDX-License-Identifier: Apache-2.0
//
// Years of shift reports: 20 vehicles in 3 shifts of 8 hours a day, all of them reporting on the
// same hours at the end of each shift.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/map_store.h"
#include "proto/core/check.h"
#include "tests/support/random_map.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

const std::string kArea = "mine";
constexpr int kVehicles = 20;
constexpr int kShiftsPerDay = 3;
constexpr Duration kShift = std::chrono::hours(8);

// A store whose ledger grows.
class Fleet {
 public:
  Fleet(int groups, int visits_per_report) : visits_(visits_per_report) {
    RandomMapOptions options;
    options.groups = groups;
    options.max_modes = 5;
    content_ = RandomContent(random_, options);
    StatusOr<MapStore> opened = MapStore::Open(path(), MapStore::Access::kReadWriteCreate);
    SHIFTMAP_CHECK(opened.ok(), "{}", Message(opened.status()));
    store_.emplace(*std::move(opened));
    StatusOr<CommitResult> version = store_->Commit(kArea, content_, {}, {});
    SHIFTMAP_CHECK(version.ok(), "{}", Message(version.status()));
    version_ = *std::move(version);
  }

  // Adds a version that goes on from the fleet's, as a nightly build does, and filters the whole
  // ledger for it. The fleet stays on its own.
  void Build() {
    CommitOptions options;
    options.parent = version_.version;
    options.states_probabilities = false;
    const StatusOr<CommitResult> built = store_->Commit(kArea, content_, {}, options);
    SHIFTMAP_CHECK(built.ok(), "{}", Message(built.status()));
    SHIFTMAP_CHECK(store_->Rollback(kArea).ok(), "no rollback");
  }

  MapStore& store() { return *store_; }
  std::string path() const { return dir_.File("a.db"); }
  int reports() const { return reports_; }
  Stamp begin() const { return content_.stamp; }
  Stamp end() const { return content_.stamp + kShift * (reports_ / kVehicles); }

  // The next vehicle's report: visits of random landmarks throughout the shift.
  ShiftReport NextReport() {
    ShiftReport report;
    report.uuid = fmt::format("{:08x}-0000-4000-8000-000000000000", reports_);
    report.vehicle = fmt::format("truck {}", reports_ % kVehicles);
    report.area = kArea;
    report.version = version_.version;
    report.content_hash = version_.content_hash;
    report.begin = content_.stamp + kShift * (reports_ / kVehicles);
    report.end = report.begin + kShift + std::chrono::seconds(10);
    report.software = "ledger_bench";
    std::uniform_int_distribution<std::size_t> group(0, content_.groups.size() - 1);
    std::uniform_int_distribution<Duration::rep> jitter(0, kShift.count() / visits_ / 2);
    for (int i = 0; i < visits_; ++i) {
      const Stamp begin = report.begin + kShift / visits_ * i + Duration(jitter(random_));
      report.evidence.push_back(RandomEvidence(
          random_, content_.groups[group(random_)], begin, begin + std::chrono::seconds(10)));
    }
    ++reports_;
    return report;
  }

  void Return(const ShiftReport& report) {
    const StatusOr<ReturnResult> result = store_->Return(report);
    SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
  }

  void Advance(int days) {
    const int until = days * kShiftsPerDay * kVehicles;
    while (reports_ < until) {
      std::vector<AttributedReport> shift(kVehicles);
      for (AttributedReport& report : shift) report.report = NextReport();
      for (const StatusOr<ReturnResult>& result : store_->ReturnAll(shift)) {
        SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
      }
    }
  }

 private:
  std::mt19937_64 random_{1};
  TempDir dir_;
  MapContent content_;
  std::optional<MapStore> store_;
  CommitResult version_;
  int visits_;
  int reports_ = 0;
};

// One fleet per (groups, visits a report), which only gets older.
Fleet& FleetAt(const benchmark::State& state) {
  static std::map<std::pair<std::int64_t, std::int64_t>, std::unique_ptr<Fleet>> fleets;
  std::unique_ptr<Fleet>& fleet = fleets[{state.range(1), state.range(2)}];
  if (!fleet) {
    fleet =
        std::make_unique<Fleet>(static_cast<int>(state.range(1)), static_cast<int>(state.range(2)));
  }
  fleet->Advance(static_cast<int>(state.range(0)));
  return *fleet;
}

void SetCounters(const Fleet& fleet, benchmark::State& state) {
  const auto bytes = static_cast<double>(std::filesystem::file_size(fleet.path()));
  state.counters["reports"] = fleet.reports();
  state.counters["bytes_per_report"] = bytes / fleet.reports();
}

void BM_LoadAtNow(benchmark::State& state) {
  Fleet& fleet = FleetAt(state);
  for (auto _ : state) benchmark::DoNotOptimize(fleet.store().LoadAt(kArea));
  SetCounters(fleet, state);
}

void BM_LoadAtAnyTime(benchmark::State& state) {
  Fleet& fleet = FleetAt(state);
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  for (auto _ : state) {
    const Stamp at =
        fleet.begin() + FromSeconds(ToSeconds(fleet.end() - fleet.begin()) * share(random));
    benchmark::DoNotOptimize(fleet.store().LoadAt(kArea, std::nullopt, at));
  }
  SetCounters(fleet, state);
}

void BM_ReturnIntoLedger(benchmark::State& state) {
  Fleet& fleet = FleetAt(state);
  for (auto _ : state) {
    state.PauseTiming();
    const ShiftReport report = fleet.NextReport();
    state.ResumeTiming();
    fleet.Return(report);
  }
  SetCounters(fleet, state);
}

void BM_PublishABuild(benchmark::State& state) {
  Fleet& fleet = FleetAt(state);
  for (auto _ : state) fleet.Build();
  SetCounters(fleet, state);
}

struct Measured {
  const char* name;
  void (*run)(benchmark::State&);
  int iterations;  // 0: as many as it takes.
};

// All of a day before the first of a later day: a fleet gets no younger again. The whole year with
// large reports takes minutes to make.
bool Register() {
  const bool whole = std::getenv("SHIFTMAP_LONG_TESTS") != nullptr;
  for (const int days : whole ? std::vector<int>{10, 100, 365} : std::vector<int>{10, 40}) {
    std::vector<std::vector<std::int64_t>> sizes = {{days, 1000, 100}, {days, 10'000, 100}};
    if (whole) sizes.push_back({days, 1000, 1000});
    for (const Measured& measured : {Measured{"BM_LoadAtNow", BM_LoadAtNow, 0},
                                     Measured{"BM_LoadAtAnyTime", BM_LoadAtAnyTime, 0},
                                     Measured{"BM_ReturnIntoLedger", BM_ReturnIntoLedger, 200},
                                     Measured{"BM_PublishABuild", BM_PublishABuild, 3}}) {
      auto* const benchmark = benchmark::RegisterBenchmark(measured.name, measured.run);
      benchmark->ArgNames({"days", "groups", "visits"})->Unit(benchmark::kMillisecond);
      for (const auto& size : sizes) benchmark->Args(size);
      if (measured.iterations > 0) benchmark->Iterations(measured.iterations);
    }
  }
  return true;
}

[[maybe_unused]] const bool registered = Register();

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
//
// Commands of shiftmap-inspect on an area of 10,000 landmarks with two versions and 100 shifts.
#include <benchmark/benchmark.h>

#include <chrono>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "mapstore/map_store.h"
#include "proto/core/check.h"
#include "tests/support/random_map.h"
#include "tests/support/temp_dir.h"
#include "tools/inspect/inspect_commands.h"

namespace shiftmap::testing {
namespace {

constexpr int kGroups = 10'000;
constexpr int kReports = 100;
constexpr int kVisits = 500;  // Per report.

class LargeArea {
 public:
  LargeArea() {
    MapContent content = RandomContent(random_, {.groups = kGroups, .max_modes = 3});
    StatusOr<MapStore> store = MapStore::Open(path(), MapStore::Access::kReadWriteCreate);
    SHIFTMAP_CHECK(store.ok(), "{}", Message(store.status()));
    CommitOptions options;
    const StatusOr<CommitResult> first = store->Commit("mine", content, {}, options);
    SHIFTMAP_CHECK(first.ok(), "{}", Message(first.status()));
    for (LandmarkGroup& group : content.groups) {
      for (Mode& mode : group.modes) mode.p_map_landmark.x() += 1e-3;
    }
    options.parent = first->version;
    options.states_probabilities = false;
    const StatusOr<CommitResult> second = store->Commit("mine", content, {}, options);
    SHIFTMAP_CHECK(second.ok(), "{}", Message(second.status()));
    for (int i = 0; i < kReports; ++i) {
      const StatusOr<ReturnResult> result = store->Return(Report(content, *second, i));
      SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
    }
    signature_ = content.groups[kGroups / 2].signature.text();
  }

  std::string path() const { return dir_.File("a.db"); }
  const std::string& signature() const { return signature_; }

 private:
  ShiftReport Report(const MapContent& content, const CommitResult& version, int number) {
    ShiftReport report;
    report.uuid = fmt::format("{:08x}-0000-4000-8000-000000000000", number);
    report.vehicle = fmt::format("truck {}", number % 10);
    report.area = "mine";
    report.version = version.version;
    report.content_hash = version.content_hash;
    report.software = "inspect_bench";
    report.begin = content.stamp + std::chrono::hours(8 * number);
    report.end = report.begin + std::chrono::hours(8);
    for (int i = 0; i < kVisits; ++i) {
      const Stamp begin = report.begin + std::chrono::seconds(50 * i);
      const auto group = static_cast<std::size_t>(number * 37 + i * 20) % content.groups.size();
      report.evidence.push_back(
          RandomEvidence(random_, content.groups[group], begin, begin + std::chrono::seconds(10)));
    }
    return report;
  }

  std::mt19937_64 random_{3};
  TempDir dir_;
  std::string signature_;
};

LargeArea& Area() {
  static auto* const area = new LargeArea();
  return *area;
}

void Run(benchmark::State& state, std::vector<std::string> arguments) {
  for (std::string& argument : arguments) {
    if (argument == "SIGNATURE") argument = Area().signature();
  }
  arguments.insert(arguments.end(), {"--store", Area().path(), "--area", "mine"});
  for (auto _ : state) {
    Application application("shiftmap-inspect", "");
    AddInspectCommands(&application);
    std::ostringstream out;
    std::ostringstream err;
    const ExitCode code = application.Run(arguments, &out, &err);
    SHIFTMAP_CHECK(code == ExitCode::kDone, "{}", err.str());
    benchmark::DoNotOptimize(out);
  }
  state.SetLabel("10,000 landmarks");
}

void History(benchmark::State& state) { Run(state, {"history", "SIGNATURE"}); }
void ModesOfOne(benchmark::State& state) { Run(state, {"modes", "SIGNATURE"}); }
void Modes(benchmark::State& state) { Run(state, {"modes"}); }
void Show(benchmark::State& state) { Run(state, {"show"}); }
void Diff(benchmark::State& state) { Run(state, {"diff", "1", "2"}); }
void Reports(benchmark::State& state) { Run(state, {"reports"}); }
void Sightings(benchmark::State& state) { Run(state, {"sightings"}); }
void Versions(benchmark::State& state) { Run(state, {"versions"}); }

BENCHMARK(History)->Unit(benchmark::kMillisecond);
BENCHMARK(ModesOfOne)->Unit(benchmark::kMillisecond);
BENCHMARK(Modes)->Unit(benchmark::kMillisecond);
BENCHMARK(Show)->Unit(benchmark::kMillisecond);
BENCHMARK(Diff)->Unit(benchmark::kMillisecond);
BENCHMARK(Reports)->Unit(benchmark::kMillisecond);
BENCHMARK(Sightings)->Unit(benchmark::kMillisecond);
BENCHMARK(Versions)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace shiftmap::testing

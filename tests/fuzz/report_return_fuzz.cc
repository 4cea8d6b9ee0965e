// SPDX-License-Identifier: Apache-2.0
//
// Returns reports whose values the input gives to a map store. What passes validation leaves a map
// that is valid at any time, and a store that can be read and built on.
#include <filesystem>
#include <iterator>

#include "mapstore/codec/shift_report.h"
#include "mapstore/map_store.h"
#include "proto/core/check.h"
#include "tests/fault/fault_plan.h"
#include "tests/fault/store_steps.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

// A stamp near one, or at an end of the type.
Stamp TakeStamp(FuzzInput* input, Stamp near) {
  const std::uint64_t kind = input->Take(1);
  if (kind == 0) return near;
  if (kind == 1) return Stamp::min();
  if (kind == 2) return Stamp::max();
  return input->Moved(near);
}

std::int64_t TakeCount(FuzzInput* input) {
  constexpr std::int64_t kCounts[] = {0, 1, 2, -1, INT64_MAX, INT64_MIN, 1'000'000};
  return kCounts[input->Index(std::size(kCounts))];
}

void TakeEvidence(FuzzInput* input, const MapSnapshot& map, ShiftReport* report) {
  const LandmarkGroup& group = map.groups()[input->Index(map.groups().size())];
  VisitEvidence evidence;
  evidence.signature = input->Take(1) % 8 == 7 ? Signature(input->Text()) : group.signature;
  evidence.begin = TakeStamp(input, report->begin);
  evidence.end = TakeStamp(input, evidence.begin);
  evidence.modes.push_back({kAbsent, input->Number()});
  for (const Mode& mode : group.modes) evidence.modes.push_back({mode.number, input->Number()});
  evidence.observations = TakeCount(input);
  report->evidence.push_back(evidence);
}

ShiftReport TakeReport(FuzzInput* input, const MapSnapshot& map, int number) {
  ShiftReport report = SmallReport(map, number);
  if (input->Take(1) % 2 == 0) report.evidence.clear();
  report.begin = TakeStamp(input, report.begin);
  report.end = TakeStamp(input, report.end);
  for (std::size_t rows = input->Index(8); rows > 0; --rows) TakeEvidence(input, map, &report);
  report.decisions.front().stamp = TakeStamp(input, report.begin);
  report.decisions.front().log_odds = input->Number();
  UnmappedSighting& sighting = report.sightings.front();
  sighting.p_map_landmark.x() = input->Number();
  sighting.cov_p_map_landmark(0, 0) = input->Number();
  sighting.cov_p_map_landmark(1, 1) = input->Number();
  sighting.count = TakeCount(input);
  sighting.first = TakeStamp(input, report.begin);
  sighting.last = TakeStamp(input, sighting.first);
  return report;
}

std::string StoreBytes() {
  const TempDir folder;
  const StoreFiles files(folder.path());
  for (const StoreStep& step : StoreLife()) {
    if (step.name == "Return1") break;
    SHIFTMAP_CHECK(step.run(files).ok(), "{}", step.name);
  }
  return ReadFile(files.store);
}

void CheckMap(const StatusOr<MapSnapshot>& map) {
  SHIFTMAP_CHECK(map.ok(), "{}", Message(map.status()));
  const Status valid = ValidateMapContent(map->content());
  SHIFTMAP_CHECK(valid.ok(), "an invalid map was derived: {}", Message(valid));
}

void ReturnReports(FuzzInput input, const StoreFiles& files) {
  StatusOr<MapStore> store = MapStore::Open(files.store, MapStore::Access::kReadWrite);
  SHIFTMAP_CHECK(store.ok(), "{}", Message(store.status()));
  for (int number = 1; number <= 3 && !input.empty(); ++number) {
    const auto map = store->LoadAt("mine");
    CheckMap(map);
    const auto report = DecodeShiftReport(EncodeShiftReport(TakeReport(&input, *map, number)));
    if (report.ok()) store->Return(*report).status().IgnoreError();
  }
  CheckMap(store->LoadAt("mine"));
  CheckMap(store->LoadAt("mine", {}, StampFromSeconds(0.0)));
  CheckMap(store->LoadAt("mine", {}, StampFromSeconds(4.0e9)));
  SHIFTMAP_CHECK(store->Reports("mine").ok() && store->Sightings("mine").ok(), "not readable");
  const auto exported = store->ExportSnapshot("mine", files.snapshot);
  SHIFTMAP_CHECK(exported.ok(), "{}", Message(exported.status()));
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  std::vector<std::string> seeds = {"", std::string(1, '\0')};
  for (std::size_t i = 0; i < std::size(kExtremes); ++i) {
    std::string numbers;
    for (int k = 0; k < 8; ++k) numbers += ExtremeNumber(i);
    for (const char stamp : {'\0', '\1', '\2'}) {
      const std::string whole{'\0', stamp, '\2', '\1'};
      seeds.push_back(whole + std::string{'\0', '\0', stamp, stamp} + numbers);
      seeds.push_back(whole + std::string{'\0', '\0', stamp, '\0'} + ExtremeNumber(0) + numbers);
    }
  }
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  static const std::string base = StoreBytes();
  static const TempDir folder;
  const StoreFiles files(folder.path());
  // Nothing fails, and nobody waits for the disk.
  FaultPlan none(Fault::kAnyOnce, 1'000'000'000);
  const ObservedFiles observed(none);
  std::filesystem::remove(files.store + "-journal");
  WriteFile(files.store, base);
  ReturnReports(FuzzInput(bytes), files);
}

}  // namespace shiftmap::testing

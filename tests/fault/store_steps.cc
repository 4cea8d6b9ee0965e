// SPDX-License-Identifier: Apache-2.0
#include "tests/fault/store_steps.h"

#include <sqlite3.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <random>
#include <utility>

#include "mapstore/maintenance/compact.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

const std::string kArea = "mine";

StatusOr<MapStore> OpenForWriting(const StoreFiles& files) {
  MapStore::OpenOptions options;
  options.access = MapStore::Access::kReadWrite;
  // So few that reports make checkpoints.
  options.checkpoint_rows = 4;
  return MapStore::Open(files.store, options);
}

StoreStep MakeStore() {
  return {"Create", [](const StoreFiles& files) {
            return MapStore::Open(files.store, MapStore::Access::kReadWriteCreate).status();
          }};
}

StoreStep CommitVersion(int number) {
  return {fmt::format("Commit{}", number), [number](const StoreFiles& files) -> Status {
            SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenForWriting(files));
            Provenance provenance;
            provenance.tool = "test";
            RunRecord run;
            run.name = fmt::format("run {}", number);
            run.sha256 = fmt::format("{:064}", number);
            run.trajectory.resize(100);
            provenance.runs = {std::move(run)};
            CommitOptions options;
            if (number > 1) options.parent = VersionNumber(number - 1);
            return store.Commit(kArea, SmallMap(number), provenance, options).status();
          }};
}

StoreStep ReturnReport(int number) {
  return {fmt::format("Return{}", number), [number](const StoreFiles& files) -> Status {
            SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenForWriting(files));
            SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, store.LoadAt(kArea));
            return store.Return(SmallReport(map, number)).status();
          }};
}

StoreStep RollBack() {
  return {"Rollback", [](const StoreFiles& files) -> Status {
            SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenForWriting(files));
            return store.Rollback(kArea, VersionNumber(1)).status();
          }};
}

StoreStep Publish() {
  return {"Publish", [](const StoreFiles& files) -> Status {
            SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenForWriting(files));
            return store.Publish(kArea, VersionNumber(2), VersionNumber(1));
          }};
}

StoreStep Export(const std::string& name) {
  return {name, [](const StoreFiles& files) -> Status {
            SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                                      MapStore::Open(files.store, MapStore::Access::kReadOnly));
            return store.ExportSnapshot(kArea, files.snapshot).status();
          }};
}

StoreStep Compact() {
  return {"Compact", [](const StoreFiles& files) {
            return CompactStore(files.store, {.keep_versions = 1, .evidence_before = {}}, false)
                .status();
          }};
}

// The area's part of a state.
StatusOr<std::string> DescribeArea(MapStore& store, const AreaSummary& area) {
  std::string text = fmt::format(
      "area {} published {}\n", area.area, area.published ? area.published->value() : 0);
  SHIFTMAP_ASSIGN_OR_RETURN(const auto versions, store.Versions(area.area));
  for (const VersionSummary& version : versions) {
    text += fmt::format("version {} of {} {} {}",
                        version.version.value(),
                        version.parent ? version.parent->value() : 0,
                        version.content_hash,
                        version.content_stored);
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance from,
                              store.LoadProvenance(area.area, version.version));
    for (const RunRecord& run : from.runs) text += fmt::format(" {} {}", run.name, run.sha256);
    if (version.content_stored) {
      SHIFTMAP_RETURN_IF_ERROR(store.LoadVersion(area.area, version.version).status());
      SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, store.LoadAt(area.area, version.version));
      // The hash covers the probabilities.
      text += " now " + ContentHash(map.content());
    }
    text += '\n';
  }
  SHIFTMAP_ASSIGN_OR_RETURN(auto reports, store.Reports(area.area));
  std::sort(
      reports.begin(), reports.end(), [](const auto& a, const auto& b) { return a.uuid < b.uuid; });
  for (const ReportSummary& report : reports) {
    text += fmt::format("report {} of {}: {} rows, {} decisions, {} sightings\n",
                        report.uuid,
                        report.version.value(),
                        report.evidence_rows,
                        report.decisions,
                        report.sightings);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const auto sightings, store.Sightings(area.area));
  return text + fmt::format("{} sightings\n", sightings.size());
}

StatusOr<std::string> Describe(const std::string& path, MapStore::Access access) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, MapStore::Open(path, access));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto areas, store.Areas());
  std::string text = fmt::format("{} areas\n", areas.size());
  for (const AreaSummary& area : areas) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string part, DescribeArea(store, area));
    text += part;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const auto audit, store.AuditLog());
  for (const AuditEntry& entry : audit) text += fmt::format("{} {}\n", entry.action, entry.subject);
  return text;
}

bool IsNothing(const std::string& path) {
  std::error_code error;
  const auto size = std::filesystem::file_size(path, error);
  return error || size == 0;
}

std::string FileState(const std::string& path, MapStore::Access access) {
  if (IsNothing(path)) return "nothing\n";
  const StatusOr<std::string> text = Describe(path, access);
  if (text.ok()) return *text;
  // Opening may have rolled back the write that would have made it.
  return IsNothing(path) ? "nothing\n" : "broken: " + Message(text.status()) + '\n';
}

}  // namespace

std::vector<StoreStep> StoreLife() {
  return {MakeStore(),
          CommitVersion(1),
          ReturnReport(1),
          ReturnReport(2),
          Export("Export"),
          CommitVersion(2),
          ReturnReport(3),
          RollBack(),
          ReturnReport(4),
          Publish(),
          Export("ExportAgain"),
          Compact()};
}

MapContent SmallMap(int number) {
  std::mt19937_64 random(7);
  RandomMapOptions options;
  options.groups = 4;
  options.anonymous_landmarks = 1;
  MapContent content = RandomContent(random, options);
  content.stamp += std::chrono::hours(number);
  random.seed(static_cast<std::uint64_t>(number));
  for (LandmarkGroup& group : content.groups) {
    group.probabilities = RandomDistribution(random, group.chain.states());
  }
  return content;
}

ShiftReport SmallReport(const MapSnapshot& map, int number) {
  std::mt19937_64 random(static_cast<std::uint64_t>(number));
  ShiftReport report;
  report.uuid = fmt::format("00000000-0000-4000-8000-{:012}", number);
  report.vehicle = "truck 1";
  report.area = map.area();
  report.version = map.version();
  report.content_hash = map.content_hash();
  report.software = "test";
  // After the stamp of any version of the tests, so that the evidence counts for all of them.
  report.begin = SmallMap(1000 + number).stamp;
  report.end = report.begin + std::chrono::minutes(30);
  for (const LandmarkGroup& group : map.groups()) {
    report.evidence.push_back(RandomEvidence(random, group, report.begin, report.end));
  }
  const Signature& signature = map.groups().front().signature;
  report.decisions.push_back({signature, ModeNumber(1), report.end, 20.0});
  UnmappedSighting sighting;
  sighting.signature = signature;
  sighting.cov_p_map_landmark = 0.01 * Eigen::Matrix2d::Identity();
  sighting.count = 3;
  sighting.first = report.begin;
  sighting.last = report.end;
  report.sightings.push_back(sighting);
  return report;
}

std::string StateOf(const StoreFiles& files) {
  return "store: " + FileState(files.store, MapStore::Access::kReadWrite) +
         "snapshot: " + FileState(files.snapshot, MapStore::Access::kReadOnly);
}

std::string CheckIntegrity(const std::string& path) {
  if (IsNothing(path)) return "ok";
  std::string result;
  sqlite3* db = nullptr;
  const auto append = [](void* text, int columns, char** values, char** /*names*/) {
    for (int i = 0; i < columns; ++i) {
      *static_cast<std::string*>(text) += values[i] == nullptr ? "null" : values[i];
    }
    return 0;
  };
  if (sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READWRITE, nullptr) != SQLITE_OK ||
      sqlite3_exec(
          db, "PRAGMA integrity_check; PRAGMA foreign_key_check", append, &result, nullptr) !=
          SQLITE_OK) {
    result += sqlite3_errmsg(db);
  }
  sqlite3_close(db);
  return result;
}

bool LongTests() { return std::getenv("SHIFTMAP_LONG_TESTS") != nullptr; }

}  // namespace shiftmap::testing

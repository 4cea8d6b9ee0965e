// SPDX-License-Identifier: Apache-2.0
//
// Writers are killed at any moment, or write side by side: nothing that was acknowledged is lost,
// and readers see whole states only.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "proto/core/check.h"
#include "tests/fault/store_steps.h"
#include "tests/fault/writer_process.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

constexpr int kKillsPerStore = 20;

// What a reader can see: "commit <version> <hash>" and "return <uuid>" lines, as writers write
// them.
StatusOr<std::set<std::string>> ReadLines(MapStore& store) {
  std::set<std::string> lines;
  SHIFTMAP_ASSIGN_OR_RETURN(const auto areas, store.Areas());
  for (const AreaSummary& area : areas) {
    SHIFTMAP_ASSIGN_OR_RETURN(const auto versions, store.Versions(area.area));
    for (const VersionSummary& version : versions) {
      lines.insert(fmt::format("commit {} {}", version.version.value(), version.content_hash));
      // Verifies the hash.
      SHIFTMAP_RETURN_IF_ERROR(store.LoadVersion(area.area, version.version).status());
    }
    SHIFTMAP_RETURN_IF_ERROR(store.LoadAt(area.area).status());
    SHIFTMAP_ASSIGN_OR_RETURN(const auto reports, store.Reports(area.area));
    for (const ReportSummary& report : reports) {
      lines.insert("return " + report.uuid);
      // A report is written in parts: evidence of 4 groups, a decision, a sighting.
      if (report.evidence_rows != 4 || report.decisions != 1 || report.sightings != 1) {
        return DataLoss("report {} is not whole", report.uuid);
      }
    }
  }
  return lines;
}

void ExpectHolds(const std::string& path, const std::vector<std::string>& acknowledged) {
  EXPECT_EQ(CheckIntegrity(path), "ok");
  StatusOr<MapStore> store = MapStore::Open(path, MapStore::Access::kReadWriteCreate);
  ASSERT_THAT(store, IsOk());
  const StatusOr<std::set<std::string>> lines = ReadLines(*store);
  ASSERT_THAT(lines, IsOk());
  for (const std::string& line : acknowledged) {
    EXPECT_TRUE(lines->contains(line)) << "lost: " << line;
  }
}

TEST(KillTest, KeepsWhatWasAcknowledged) {
  const int kills = LongTests() ? 1000 : 30;
  std::mt19937_64 random(TestSeed(5));
  std::unique_ptr<TempDir> dir;
  std::vector<std::string> acknowledged;
  int busy = 0;
  std::size_t total = 0;
  for (int kill = 0; kill < kills; ++kill) {
    SCOPED_TRACE(fmt::format("kill {}", kill));
    if (kill % kKillsPerStore == 0) {
      dir = std::make_unique<TempDir>();
      acknowledged.clear();
    }
    const std::size_t before = acknowledged.size();
    WriterProcess writer(dir->File("a.db"), kill, 0);
    std::this_thread::sleep_for(
        std::chrono::microseconds(std::uniform_int_distribution<int>(0, 200'000)(random)));
    ASSERT_TRUE(writer.Kill(&acknowledged)) << "the writer gave up";
    busy += acknowledged.size() > before ? 1 : 0;
    total += acknowledged.size() - before;
    ASSERT_NO_FATAL_FAILURE(ExpectHolds(dir->File("a.db"), acknowledged));
    ASSERT_FALSE(HasFailure());
  }
  RecordProperty("kills_while_busy", busy);
  RecordProperty("acknowledged", static_cast<int>(total));
  EXPECT_GT(busy, 0) << "every writer was killed before its first write";
}

TEST(KillTest, TwoWritersAndAReader) {
  const TempDir dir;
  const std::string path = dir.File("a.db");
  ASSERT_THAT(MapStore::Open(path, MapStore::Access::kReadWriteCreate), IsOk());
  WriterProcess first(path, 1, 20);
  WriterProcess second(path, 2, 20);
  MapStore::OpenOptions options;
  options.lock_timeout = std::chrono::seconds(60);
  StatusOr<MapStore> reader = MapStore::Open(path, options);
  ASSERT_THAT(reader, IsOk());
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(LongTests() ? 60 : 2);
  std::set<std::string> seen;
  int reads = 0;
  while (std::chrono::steady_clock::now() < end) {
    const StatusOr<std::set<std::string>> lines = ReadLines(*reader);
    ASSERT_THAT(lines, IsOk());
    for (const std::string& line : seen) ASSERT_TRUE(lines->contains(line)) << "gone: " << line;
    seen = *lines;
    ++reads;
    // Readers that hold the file all the time would keep writers out.
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  std::vector<std::string> acknowledged[2];
  EXPECT_TRUE(first.Kill(&acknowledged[0])) << "the writer gave up";
  EXPECT_TRUE(second.Kill(&acknowledged[1])) << "the writer gave up";
  for (const std::vector<std::string>& lines : acknowledged) {
    EXPECT_FALSE(lines.empty());
    ExpectHolds(path, lines);
  }
  RecordProperty("reads", reads);
  RecordProperty("writes", static_cast<int>(acknowledged[0].size() + acknowledged[1].size()));
}

}  // namespace
}  // namespace shiftmap::testing

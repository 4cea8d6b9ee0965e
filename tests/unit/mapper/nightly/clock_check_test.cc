// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/clock_check.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <random>
#include <string>
#include <vector>

#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using std::chrono::hours;
using std::chrono::minutes;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::IsOk;
using ::testing::SizeIs;

std::string Uuid(int number) { return fmt::format("0f8fad5b-d9cb-469f-a165-{:012x}", number); }

// A site whose store has a clock of its own, and a night that built one run. Times count from the
// begin of the run that made the first map.
class ClockCheckTest : public ::testing::Test {
 protected:
  ClockCheckTest() {
    std::mt19937_64 random(1);
    testing::RandomMapOptions map;
    map.groups = 3;
    map.stamp_ns = ToNanoseconds(At(hours(1)));
    content_ = testing::RandomContent(random, map);
    Provenance provenance;
    provenance.runs = {Run("other", 1, hours(0), hours(1))};
    CommitOptions options;
    options.states_probabilities = false;
    MapStore store = Store(hours(2));
    const auto committed = store.Commit("floor", content_, provenance, options);
    EXPECT_THAT(committed.status(), IsOk());
    hash_ = committed->content_hash;
  }

  static Stamp At(Duration after) { return StampFromSeconds(1'767'000'000) + after; }

  static RunRecord Run(const std::string& vehicle, int number, Duration begin, Duration end) {
    RunRecord run;
    run.name = fmt::format("run {}", number);
    run.sha256 = fmt::format("{:064x}", number);
    run.vehicle = vehicle;
    run.begin = At(begin);
    run.end = At(end);
    run.uuid = Uuid(number);
    return run;
  }

  // The store, at a time of its own clock.
  MapStore Store(Duration now) const {
    MapStore::OpenOptions options;
    options.access = MapStore::Access::kReadWriteCreate;
    options.clock = [now] { return At(now); };
    return *MapStore::Open(dir_.File("maps.db"), options);
  }

  // @param live  Else the report is about a recorded log.
  void Report(const RunRecord& run, Duration received, bool live = true) const {
    ShiftReport report;
    report.uuid = Uuid(1000 + static_cast<int>(received / minutes(1)));
    report.vehicle = run.vehicle;
    report.area = "floor";
    report.version = VersionNumber(1);
    report.content_hash = hash_;
    if (!live) report.run_hash = run.sha256;
    report.run_uuid = run.uuid;
    report.software = "test";
    report.begin = run.begin;
    report.end = run.end;
    MapStore store = Store(received);
    EXPECT_THAT(store.Return(report).status(), IsOk());
  }

  // Two other vehicles whose reports come half an hour after their shifts.
  void OthersReport() const {
    for (const int day : {1, 2}) {
      const Duration end = hours(24 * day + 9);
      Report(Run("other", 10 + day, end - hours(1), end), end + minutes(30));
    }
  }

  // What the night says of runs that it built on version 1.
  Judgement Check(const std::vector<RunRecord>& runs, std::vector<EvidenceRow> rows = {}) const {
    JudgedVersion version{std::nullopt,
                          VersionNumber(1),
                          MapSnapshot("floor", VersionNumber(1), hash_, content_),
                          {},
                          std::move(rows)};
    version.provenance.runs = runs;
    std::vector<LogHead> logs;
    for (const RunRecord& run : runs) {
      LogHead log;
      log.path = run.name;  // No file: nothing is known of when it was changed.
      log.info.vehicle = run.vehicle;
      log.info.uuid = run.uuid;
      logs.push_back(log);
    }
    Judgement judgement;
    MapStore store = Store(hours(1000));
    EXPECT_THAT(CheckClocks("floor", version, logs, &store, &judgement), IsOk());
    return judgement;
  }

  testing::TempDir dir_;
  MapContent content_;
  std::string hash_;
};

void ExpectSuspect(const Judgement& judgement, const std::string& text) {
  ASSERT_THAT(judgement.suspects, SizeIs(1));
  EXPECT_THAT(judgement.suspects[0].reason, HasSubstr(text));
  EXPECT_THAT(judgement.doubts, IsEmpty());
}

TEST_F(ClockCheckTest, ARunThatComesSoonIsAsItSays) {
  OthersReport();
  const RunRecord run = Run("truck", 7, hours(70), hours(71));
  Report(run, hours(71) + minutes(10));
  const Judgement judgement = Check({run});
  EXPECT_THAT(judgement.suspects, IsEmpty());
  EXPECT_THAT(judgement.doubts, IsEmpty());
}

TEST_F(ClockCheckTest, ALogThatEndsAfterItWasHandedInIsAhead) {
  OthersReport();
  const RunRecord run = Run("truck", 7, hours(70), hours(71));
  MapStore store = Store(hours(69));
  ASSERT_THAT(store.NoteUpload(run.sha256, "truck"), IsOk());
  ExpectSuspect(Check({run}), "its clock is ahead");
}

TEST_F(ClockCheckTest, AShiftThatBeganBeforeItsMapWasMadeIsBehind) {
  OthersReport();
  // No other run was then, and the runs that made the map were over.
  const RunRecord run = Run("truck", 7, minutes(80), minutes(100));
  Report(run, hours(71));
  ExpectSuspect(Check({run}), "its clock is behind");
}

// The clock of the store says nothing there, that of the fleet does.
TEST_F(ClockCheckTest, WhereMapsAreMadeOfRecordedDataTheRunsOfTheMapTell) {
  const auto year = hours(9000);
  Report(Run("other", 10, hours(23), hours(24)), year);
  const RunRecord after = Run("truck", 7, minutes(80), minutes(100));
  Report(after, year + minutes(1));
  EXPECT_THAT(Check({after}).suspects, IsEmpty());
  const RunRecord before = Run("truck", 8, -hours(3), -hours(2));
  Report(before, year + minutes(2));
  ExpectSuspect(Check({before}), "its clock is behind");
}

// A log may be localized again on a map that was made of it.
TEST_F(ClockCheckTest, AReportAboutARecordedLogTellsNothingOfItsClock) {
  OthersReport();
  const RunRecord run = Run("truck", 7, minutes(80), minutes(100));
  Report(run, minutes(110), /*live=*/false);
  EXPECT_THAT(Check({run}).suspects, IsEmpty());
}

TEST_F(ClockCheckTest, WhereNothingDecidesThatIsSaid) {
  OthersReport();
  const RunRecord run = Run("truck", 7, hours(40), hours(41));
  MapStore store = Store(hours(71));
  ASSERT_THAT(store.NoteUpload(run.sha256, "truck"), IsOk());
  const Judgement judgement = Check({run});
  EXPECT_THAT(judgement.suspects, IsEmpty());
  ASSERT_THAT(judgement.doubts, SizeIs(1));
  EXPECT_THAT(judgement.doubts[0], HasSubstr("30.0 h after it ends, others 0.5 h"));
  EXPECT_THAT(judgement.doubts[0], HasSubstr("nothing tells which"));
}

TEST_F(ClockCheckTest, OfTwoLogsOfANightThatOverlapBothAreNamed) {
  std::mt19937_64 random(2);
  const RunRecord first = Run("truck", 7, hours(70), hours(71));
  const RunRecord second = Run("truck", 8, hours(70) + minutes(30), hours(72));
  const LandmarkGroup& group = content_.groups.front();
  std::vector<EvidenceRow> rows;
  for (const RunRecord& run : {first, second}) {
    rows.push_back(
        {run.sha256, testing::RandomEvidence(random, group, run.begin, run.end), run.vehicle});
  }
  const Judgement judgement = Check({first, second}, rows);
  ASSERT_THAT(judgement.suspects, SizeIs(2));
  EXPECT_THAT(judgement.suspects[0].reason, HasSubstr("another log of this night"));
  // The other one is mapped: then it is this one.
  const Judgement one = Check({second}, rows);
  ExpectSuspect(one, "its clock is wrong: vehicle 'truck' was in another run");
}

}  // namespace
}  // namespace shiftmap

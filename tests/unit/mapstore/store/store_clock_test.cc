// SPDX-License-Identifier: Apache-2.0
//
// Stamps that are ahead of the host's clock: refused, and without effect where an older build let
// them in.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include "mapstore/maintenance/verify.h"
#include "mapstore/map_store.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

constexpr double kRate = 1e-6;
constexpr double kYearS = 365.25 * 86'400.0;

class StoreClockTest : public ::testing::Test {
 protected:
  MapStore Open(double now_s, double tolerance_s = kDefaultClockToleranceS) const {
    MapStore::OpenOptions options;
    options.access = MapStore::Access::kReadWriteCreate;
    options.clock = [now_s] { return At(now_s); };
    options.clock_tolerance_s = tolerance_s;
    return *MapStore::Open(path_, options);
  }

  // A map of landmark A, which is surely at its mode at time 0.
  CommitResult Make() const {
    return *Open(1e9).Commit("a", TwoStateContent(kRate, 0.999, At(0.0)), {}, {});
  }

  static ShiftReport Report(const CommitResult& version, double end_s, int number) {
    ShiftReport report = EmptyReport(version, "a", number);
    report.begin = At(end_s - 10.0);
    report.end = At(end_s);
    report.evidence = {TwoStateEvidence(At(end_s - 5.0), At(end_s), 0.0, 0.0)};
    return report;
  }

  // Why rows of a report do not count.
  static std::vector<SetAside> Aside(const StatusOr<ReturnResult>& result) {
    std::vector<SetAside> reasons;
    for (const SetAsideRows& rows : result->set_aside) reasons.push_back(rows.reason);
    return reasons;
  }

  static double Present(MapStore store, std::optional<Stamp> at = std::nullopt) {
    return store.LoadAt("a", std::nullopt, at)->groups()[0].probabilities(1);
  }

  TempDir dir_;
  const std::string path_ = dir_.File("maps.db");
};

TEST_F(StoreClockTest, AReportFromTheFutureIsRefusedWithBothTimes) {
  const CommitResult version = Make();
  MapStore store = Open(1000.0);
  EXPECT_THAT(store.Return(Report(version, 1600.0, 1)), IsOk());
  const std::string before = ReadFile(path_);
  const Status refused = store.Return(Report(version, 1601.0, 2)).status();
  EXPECT_THAT(refused, StatusIs(StatusCode::kInvalidArgument, "ends at 2023-11-14 22:40:01 UTC"));
  EXPECT_THAT(refused, StatusIs(StatusCode::kInvalidArgument, "it is 2023-11-14 22:30:00 UTC"));
  EXPECT_EQ(store.CheckClock(Report(version, 1601.0, 2)), refused);
  EXPECT_TRUE(ReadFile(path_) == before);
  EXPECT_THAT(Open(1000.0, 601.0).Return(Report(version, 1601.0, 2)), IsOk());
}

// Nobody can drive on a map before the newest run in it ended. A log can be localized on it later.
TEST_F(StoreClockTest, AShiftThatEndsBeforeItsMapIsHeld) {
  const CommitResult version = Make();
  MapStore store = Open(1000.0);
  EXPECT_THAT(Aside(store.Return(Report(version, -600.0, 1))), ::testing::IsEmpty());
  ShiftReport of_log = Report(version, -601.0, 2);
  of_log.run_hash = std::string(64, 'a');
  EXPECT_THAT(Aside(store.Return(of_log)), ::testing::IsEmpty());
  const double before = Present(Open(1000.0), At(0.0));

  ShiftReport behind = Report(version, -601.0, 3);
  behind.evidence[0].modes[0].log_likelihood = 5.0;  // It does not see the landmark.
  behind.run_uuid = "00000000-0000-4000-8000-00000000000A";
  EXPECT_THAT(Aside(store.Return(behind)), ::testing::ElementsAre(SetAside::kHeld));
  EXPECT_EQ(Present(Open(1000.0), At(0.0)), before);
  const std::vector<Exclusion> held = *store.Exclusions("a");
  ASSERT_EQ(held.size(), 1U);
  EXPECT_TRUE(held[0].held);
  EXPECT_EQ(held[0].run, "00000000-0000-4000-8000-00000000000a");
  EXPECT_EQ(held[0].reason,
            "its clock is behind: it ends at 2023-11-14 22:03:19 UTC, and was driven on version 1, "
            "which is of 2023-11-14 22:13:20 UTC");
  // Who knows better takes it in.
  ASSERT_THAT(store.IncludeAll("a", {{held[0].run, "", {}, "", {}}}), IsOk());
  EXPECT_LT(Present(Open(1000.0), At(0.0)), before);
  EXPECT_TRUE(VerifyStore(path_)->clean());
}

// A report that comes late is of the map that was there then, whatever was made since.
TEST_F(StoreClockTest, AShiftThatEndsBeforeANewerMapIsNotHeld) {
  const CommitResult version = Make();
  MapStore store = Open(1e5);
  ASSERT_THAT(store.Commit("a",
                           TwoStateContent(kRate, 0.9, At(9e4)),
                           {},
                           {.parent = version.version, .publish = true}),
              IsOk());
  EXPECT_THAT(Aside(store.Return(Report(version, 2000.0, 1))),
              ::testing::Not(::testing::Contains(SetAside::kHeld)));
  EXPECT_THAT(*store.Exclusions("a"), ::testing::IsEmpty());
}

// What a person took in stays in, whatever else comes of the run.
TEST_F(StoreClockTest, ARunThatWasTakenInIsNotHeldAgain) {
  const CommitResult version = Make();
  MapStore store = Open(1000.0);
  ShiftReport behind = Report(version, -700.0, 1);
  behind.run_uuid = "00000000-0000-4000-8000-00000000000A";
  ASSERT_THAT(store.Exclude("a", {behind.run_uuid, "", {}, "by a night", true, {}}), IsOk());
  ASSERT_THAT(store.IncludeAll("a", {{behind.run_uuid, "", {}, "", {}}}), IsOk());
  EXPECT_THAT(Aside(store.Return(behind)), ::testing::IsEmpty());
  EXPECT_THAT(*store.Exclusions("a"), ::testing::IsEmpty());
}

// Whoever hands in such a report knows of it.
TEST_F(StoreClockTest, AShiftOfAClockThatWasNotSetCountsInAStore) {
  const CommitResult version = Make();
  MapStore store = Open(1000.0);
  const double boot_s = -ToSecondsSinceEpoch(At(0.0));
  EXPECT_THAT(Aside(store.Return(Report(version, boot_s + 100.0, 1))), ::testing::IsEmpty());
}

// A version that is ahead of the time at which it was made says nothing of a shift.
TEST_F(StoreClockTest, AShiftOnAVersionThatIsAheadIsNotHeld) {
  MapStore lenient = Open(1000.0, 2.0 * kYearS);
  const CommitResult ahead = *lenient.Commit("a", TwoStateContent(kRate, 0.9, At(kYearS)), {}, {});
  EXPECT_THAT(Aside(Open(3000.0).Return(Report(ahead, 2000.0, 1))), ::testing::IsEmpty());
  EXPECT_THAT(Aside(Open(2.0 * kYearS).Return(Report(ahead, 2000.0, 2))), ::testing::IsEmpty());
  EXPECT_THAT(Aside(Open(3000.0).Return(Report(ahead, 390.0, 3))),
              ::testing::ElementsAre(SetAside::kHeld));
}

TEST_F(StoreClockTest, AVisitFromTheFutureInAReportOfTodayIsRefused) {
  const CommitResult version = Make();
  ShiftReport report = Report(version, 1000.0, 1);
  report.evidence[0].end = At(10.0 * kYearS);
  EXPECT_THAT(Open(1000.0).Return(report),
              StatusIs(StatusCode::kInvalidArgument, "evidence[0]: 1700000995.000000 s to 2015"));
}

TEST_F(StoreClockTest, AVersionFromTheFutureIsRefused) {
  MapStore store = Open(0.0);
  EXPECT_THAT(store.Commit("a", TwoStateContent(kRate, 0.9, At(601.0)), {}, {}),
              StatusIs(StatusCode::kInvalidArgument, "601 s ahead, expected at most 600"));
  EXPECT_THAT(store.PublishedVersion("a"), IsOk());
  EXPECT_EQ(*store.PublishedVersion("a"), std::nullopt);
  EXPECT_THAT(store.Commit("a", TwoStateContent(kRate, 0.9, At(600.0)), {}, {}), IsOk());
}

TEST_F(StoreClockTest, AVersionThatIsAheadAlreadyDoesNotLockTheArea) {
  const CommitResult ahead =
      *Open(10.0 * kYearS).Commit("a", TwoStateContent(kRate, 0.9, At(10.0 * kYearS)), {}, {});
  MapStore store = Open(1000.0);
  const auto commit = [&](double stamp_s) {
    return store
        .Commit("a",
                TwoStateContent(kRate, 0.9, At(stamp_s)),
                {},
                {.parent = ahead.version, .publish = false})
        .status();
  };
  EXPECT_THAT(commit(1000.0), IsOk());
  EXPECT_THAT(commit(1601.0), StatusIs(StatusCode::kInvalidArgument, "ahead"));
  EXPECT_THAT(Aside(store.Return(Report(ahead, 1000.0, 1))), ::testing::IsEmpty());
}

TEST_F(StoreClockTest, OneVisitOfTheFarFutureDoesNotChangeTheMapOfToday) {
  const CommitResult version = Make();
  const double before = Present(Open(1000.0));
  ASSERT_THAT(Open(20.0 * kYearS).Return(Report(version, 10.0 * kYearS, 1)), IsOk());
  EXPECT_EQ(Present(Open(1000.0)), before);
  EXPECT_GT(Present(Open(1000.0), At(1000.0)), 0.99);
  // It counts once its time has come.
  EXPECT_NEAR(Present(Open(20.0 * kYearS)), 0.5, 1e-3);
}

TEST_F(StoreClockTest, ASnapshotOfSuchAStoreIsOfToday) {
  const CommitResult version = Make();
  ASSERT_THAT(Open(20.0 * kYearS).Return(Report(version, 10.0 * kYearS, 1)), IsOk());
  MapStore store = Open(1000.0);
  const double expected = Present(Open(1000.0));
  ASSERT_THAT(store.ExportSnapshot("a", dir_.File("snapshot.db")), IsOk());
  MapStore::OpenOptions options;
  for (const double now_s : {1000.0, -20.0 * kYearS}) {
    options.clock = [now_s] { return At(now_s); };
    EXPECT_EQ(Present(*MapStore::Open(dir_.File("snapshot.db"), options)), expected);
  }
}

TEST_F(StoreClockTest, VerifyFindsWhatIsAhead) {
  const CommitResult version = Make();
  EXPECT_TRUE(VerifyStore(path_)->findings.empty());
  ASSERT_THAT(Open(2.5e9).Return(Report(version, 2.4e9, 1)), IsOk());
  ASSERT_THAT(Open(2.5e9).Commit("b", TwoStateContent(kRate, 0.9, At(2.45e9)), {}, {}), IsOk());
  const VerifyResult result = *VerifyStore(path_);
  EXPECT_TRUE(result.clean());
  ASSERT_EQ(result.findings.size(), 2U);
  EXPECT_NE(result.findings[0].find("1 versions ahead of this host's clock"), std::string::npos);
  EXPECT_NE(result.findings[1].find("1 visits ahead of this host's clock"), std::string::npos);
}

TEST_F(StoreClockTest, AStoreWithACycleOfParentsTakesNoVersion) {
  const CommitResult version = Make();
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path_.c_str(), &db), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(
                db, "UPDATE version SET parent_version_id = version_id", nullptr, nullptr, nullptr),
            SQLITE_OK);
  sqlite3_close(db);
  MapStore store = Open(1000.0);
  const std::string before = ReadFile(path_);
  EXPECT_THAT(store.Commit("a",
                           TwoStateContent(kRate, 0.9, At(10.0)),
                           {},
                           {.parent = version.version, .publish = true}),
              StatusIs(StatusCode::kDataLoss, "version 1: its parent is not an older version"));
  EXPECT_TRUE(ReadFile(path_) == before);
}

}  // namespace
}  // namespace shiftmap::testing

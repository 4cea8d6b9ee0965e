// SPDX-License-Identifier: Apache-2.0
//
// Versions whose probabilities are derived: mapped runs and reports as one memory.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <numeric>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "mapstore/maintenance/verify.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map_store.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kRate = 1e-3;

class MappedEvidenceTest : public ::testing::Test {
 protected:
  static std::string Hash(int run) { return fmt::format("{:064x}", run + 1); }

  // One visit of 'A' per 100 s; what it says of mode 1 against absent depends on the run.
  static double RatioOf(int run) { return 2.0 * std::sin(1.7 * run + 0.4); }

  static RunRecord Run(int run) {
    RunRecord record{fmt::format("run {}", run),
                     Hash(run),
                     "truck 1",
                     At(100.0 * run),
                     At(100.0 * run + 90.0),
                     {}};
    record.evidence = {
        TwoStateEvidence(At(100.0 * run + 10.0), At(100.0 * run + 30.0), 0.0, RatioOf(run))};
    return record;
  }

  static MapContent Content(int last_run) {
    return TwoStateContent(kRate, 0.5, At(100.0 * last_run + 90.0));
  }

  static CommitOptions Derived(std::optional<VersionNumber> parent) {
    CommitOptions options;
    options.parent = parent;
    options.states_probabilities = false;
    return options;
  }

  // A report about a run that says something else than mapping it does.
  static ShiftReport Report(const CommitResult& version, int run) {
    ShiftReport report = EmptyReport(version, "a", run);
    report.run_hash = Hash(run);
    report.evidence = {
        TwoStateEvidence(At(100.0 * run + 5.0), At(100.0 * run + 35.0), 0.0, -RatioOf(run))};
    return report;
  }

  // The chain by hand: P(mode 1) after the runs' visits, from one half on, `seconds` after the
  // last. All are of one vehicle.
  static double ByHand(const std::vector<int>& runs, double seconds) {
    return Believed(Alone(runs, seconds));
  }

  static double Alone(const std::vector<int>& runs, double seconds) {
    double p = 0.5;
    double end = 0.0;
    for (const int run : runs) {
      const double gap = 100.0 * run + 10.0 - end;
      p = 0.5 + (p - 0.5) * std::exp(-2.0 * kRate * gap);
      p = p * std::exp(RatioOf(run)) / (p * std::exp(RatioOf(run)) + 1.0 - p);
      end = 100.0 * run + 30.0;
    }
    return 0.5 + (p - 0.5) * std::exp(-2.0 * kRate * seconds);
  }

  // Where no other vehicle has spoken: what its visits say, or that they are mistakes.
  static double Believed(double p) {
    return (1.0 - kMistakeProbability) * p + kMistakeProbability / 2.0;
  }

  TempDir dir_;
  MapStore store_ = OpenStore(dir_.File("a.db"));

  CommitResult Map(std::vector<int> runs, std::optional<VersionNumber> parent) {
    Provenance provenance;
    for (const int run : runs) provenance.runs.push_back(Run(run));
    const int last = *std::max_element(runs.begin(), runs.end());
    const auto result = store_.Commit("a", Content(last), provenance, Derived(parent));
    EXPECT_THAT(result, IsOk());
    return *result;
  }

  double At1(std::optional<Stamp> at, std::optional<VersionNumber> version = std::nullopt) {
    const auto map = store_.LoadAt("a", version, at);
    EXPECT_THAT(map, IsOk());
    return map->groups()[0].probabilities(1);
  }
};

TEST_F(MappedEvidenceTest, ProbabilitiesAreThoseOfTheVisitsByHand) {
  const CommitResult first = Map({0, 1}, std::nullopt);
  EXPECT_NEAR(At1(At(190.0)), ByHand({0, 1}, 60.0), 1e-12);
  EXPECT_EQ(store_.LoadAt("a")->stamp(), At(190.0));
  const CommitResult second = Map({2, 3}, first.version);
  EXPECT_NEAR(At1(At(390.0)), ByHand({0, 1, 2, 3}, 60.0), 1e-12);
  // A version knows what it mapped, also for who asks for an earlier time.
  EXPECT_EQ(At1(At(95.0)), At1(At(390.0)));
  EXPECT_EQ(store_.LoadAt("a", std::nullopt, At(95.0))->stamp(), At(390.0));
  // The parent does not know the later runs.
  EXPECT_NEAR(At1(At(390.0), first.version), ByHand({0, 1}, 260.0), 1e-12);
  EXPECT_EQ(store_.LoadVersion("a", second.version)->groups()[0].probabilities(1), 0.5);
}

// Grouped in any way into builds, returned before or after: the same bits.
TEST_F(MappedEvidenceTest, BuildsAndReturnsInAnyOrderGiveTheSameBits) {
  std::mt19937_64 random(TestSeed(3));
  std::vector<double> results;
  for (int round = 0; round < 24; ++round) {
    store_ = OpenStore(dir_.File(fmt::format("round {}", round)));
    CommitResult newest = *store_.Commit("a", Content(0), {}, Derived(std::nullopt));
    const CommitResult first = newest;
    // Runs 0 to 5 are mapped, in order but in builds of any size; 0 to 7 are reported.
    std::vector<int> reports{0, 1, 2, 3, 4, 5, 6, 7};
    std::shuffle(reports.begin(), reports.end(), random);
    int next = 0;
    while (next < 6 || !reports.empty()) {
      if (next < 6 && (reports.empty() || random() % 2 == 0)) {
        std::vector<int> runs;
        for (int size = 1 + static_cast<int>(random() % 3); size > 0 && next < 6; --size) {
          runs.push_back(next++);
        }
        newest = Map(runs, newest.version);
      } else {
        const bool old = random() % 2 == 0;
        ASSERT_THAT(store_.Return(Report(old ? first : newest, reports.back())), IsOk());
        reports.pop_back();
      }
    }
    results.push_back(At1(At(1000.0)));
    EXPECT_EQ(results.back(), results.front());
  }
  // Of the reports only those about runs that no version mapped say anything.
  double p = Alone({0, 1, 2, 3, 4, 5}, 605.0 - 530.0);
  for (const int run : {6, 7}) {
    p = p * std::exp(-RatioOf(run)) / (p * std::exp(-RatioOf(run)) + 1.0 - p);
    const double until = run == 6 ? 705.0 - 635.0 : 1000.0 - 735.0;
    p = 0.5 + (p - 0.5) * std::exp(-2.0 * kRate * until);
  }
  EXPECT_NEAR(results.front(), Believed(p), 1e-12);
}

TEST_F(MappedEvidenceTest, ARollbackTakesTheMappedRunsBackAndTheirReportsCount) {
  const CommitResult first = Map({0}, std::nullopt);
  ASSERT_THAT(store_.Return(Report(first, 1)), IsOk());
  const double before = At1(At(500.0));
  const CommitResult second = Map({1}, first.version);
  EXPECT_NE(At1(At(500.0)), before);
  ASSERT_THAT(store_.Rollback("a"), IsOk());
  EXPECT_EQ(At1(At(500.0)), before);
  EXPECT_NEAR(At1(At(500.0), second.version), ByHand({0, 1}, 370.0), 1e-12);
}

// Delete everything that is derived, and load again.
TEST_F(MappedEvidenceTest, CheckpointsChangeNoBit) {
  MapStore::OpenOptions options;
  options.access = MapStore::Access::kReadWriteCreate;
  options.checkpoint_rows = 2;
  store_ = *MapStore::Open(dir_.File("dense.db"), options);
  MapStore plain = OpenStore(dir_.File("plain.db"));
  std::optional<VersionNumber> parent;
  for (int run = 0; run < 20; ++run) {
    parent = Map({run}, parent).version;
    const auto same =
        plain.Commit("a",
                     Content(run),
                     {"", "", 0, {Run(run)}},
                     Derived(run == 0 ? std::nullopt : std::optional(VersionNumber(run))));
    ASSERT_THAT(same, IsOk());
    for (const double at : {50.0, 100.0 * run + 20.0, 3000.0}) {
      EXPECT_EQ(At1(At(at)), plain.LoadAt("a", std::nullopt, At(at))->groups()[0].probabilities(1));
    }
  }
}

// A live shift that is held may be of a run that is mapped, or reported by its log.
TEST_F(MappedEvidenceTest, AHeldShiftTakesWhatElseIsKnownOfItsRunOutOfTheCheckpoints) {
  const std::string path = dir_.File("held.db");
  MapStore::OpenOptions options;
  options.access = MapStore::Access::kReadWriteCreate;
  options.checkpoint_rows = 2;
  store_ = *MapStore::Open(path, options);
  Provenance provenance;
  for (int run = 0; run < 20; ++run) provenance.runs.push_back(Run(run));
  provenance.runs[0].uuid = "00000000-0000-4000-8000-00000000000a";
  const CommitResult map = *store_.Commit("a", Content(19), provenance, Derived(std::nullopt));
  ShiftReport behind = EmptyReport(map, "a", 1);
  behind.begin = At(0.0);
  behind.end = At(90.0);
  behind.run_uuid = provenance.runs[0].uuid;
  ASSERT_THAT(store_.Return(behind), IsOk());
  ASSERT_THAT(*store_.Exclusions("a"), SizeIs(1));
  std::vector<int> others(19);
  std::iota(others.begin(), others.end(), 1);
  EXPECT_NEAR(At1(At(2000.0)), ByHand(others, 70.0), 1e-12);
  EXPECT_TRUE(VerifyStore(path)->clean());

  ShiftReport of_log = behind;
  of_log.uuid = EmptyReport(map, "a", 2).uuid;
  of_log.run_uuid = "00000000-0000-4000-8000-00000000000b";
  of_log.run_hash = Hash(30);
  of_log.evidence = {TwoStateEvidence(At(20.0), At(35.0), 0.0, 3.0)};
  ASSERT_THAT(store_.Return(of_log), IsOk());
  // Makes checkpoints.
  ASSERT_THAT(store_.Exclude("a", {"", "truck 2", At(0.0), "test", false, {}}), IsOk());
  behind.uuid = EmptyReport(map, "a", 3).uuid;
  behind.run_uuid = of_log.run_uuid;
  EXPECT_NE(At1(At(2000.0)), ByHand(others, 70.0));
  ASSERT_THAT(store_.Return(behind), IsOk());
  EXPECT_NEAR(At1(At(2000.0)), ByHand(others, 70.0), 1e-12);
  EXPECT_TRUE(VerifyStore(path)->clean());
}

// A version is published over a long ledger while vehicles hand in their shifts, of any age.
TEST_F(MappedEvidenceTest, CheckpointsAreMadeWhileOthersWrite) {
  const std::string path = dir_.File("busy.db");
  MapStore::OpenOptions options;
  options.access = MapStore::Access::kReadWriteCreate;
  options.checkpoint_rows = 3;
  options.lock_timeout = std::chrono::minutes(2);  // Of a disk that other programs keep busy.
  store_ = *MapStore::Open(path, options);
  std::vector<int> runs(200);
  std::iota(runs.begin(), runs.end(), 0);
  const CommitResult first = Map(runs, std::nullopt);
  std::thread vehicles([&] {
    MapStore other = *MapStore::Open(path, options);
    std::mt19937_64 random(TestSeed(4));
    for (int i = 0; i < 40; ++i) {
      ShiftReport report = EmptyReport(first, "a", 1000 + i);
      const double begin = static_cast<double>(random() % 20'000);
      report.evidence = {TwoStateEvidence(At(begin), At(begin + 5.0), 0.0, 0.3)};
      EXPECT_THAT(other.Return(report), IsOk());
    }
  });
  for (int i = 0; i < 20; ++i) {
    Map({200 + i}, VersionNumber(i + 1));
  }
  vehicles.join();
  EXPECT_TRUE(VerifyStore(path)->clean());
  Map({220}, VersionNumber(21));  // A shift of old may have come last, and taken checkpoints away.
  const StatusOr<VerifyResult> verified = VerifyStore(path);
  ASSERT_THAT(verified, IsOk());
  EXPECT_TRUE(verified->clean());
  EXPECT_GT(verified->checkpoints, 20);
}

TEST_F(MappedEvidenceTest, OnlyAVehiclesOwnReportStandsForItsRun) {
  const CommitResult first = Map({0}, std::nullopt);
  const ShiftReport honest = Report(first, 3);
  ASSERT_THAT(store_.Return(honest), IsOk());
  const double known = At1(At(900.0));
  // The lowest UUID, the same log, another vehicle, and nothing to say.
  ShiftReport forged = EmptyReport(first, "a", 0);
  forged.uuid = "00000000-0000-0000-0000-000000000000";
  forged.run_hash = honest.run_hash;
  forged.vehicle = "truck 666";
  EXPECT_THAT(store_.Return(forged)->set_aside, IsEmpty());
  EXPECT_EQ(At1(At(900.0)), known);
}

// A liar among three others, one of which has a mapped run.
TEST_F(MappedEvidenceTest, AVehicleThatTheOthersContradictIsNamed) {
  const CommitResult first = Map({0}, std::nullopt);
  const auto speak = [&](int time, const std::string& vehicle, double log_ratio) {
    ShiftReport report = EmptyReport(first, "a", 100 + time);
    report.vehicle = vehicle;
    report.evidence = {
        TwoStateEvidence(At(100.0 * time + 5.0), At(100.0 * time + 35.0), 0.0, log_ratio)};
    ASSERT_THAT(store_.Return(report), IsOk());
  };
  for (int time = 1; time < 30; ++time) {
    const bool lies = time % 3 == 0;
    speak(time, lies ? "liar" : "truck " + std::to_string(1 + time % 3), lies ? -8.0 : 8.0);
  }
  const std::vector<VehicleTrust> trust = *store_.Trust("a");
  ASSERT_THAT(trust, SizeIs(4));
  EXPECT_EQ(trust[0].vehicle, "liar");
  EXPECT_TRUE(IsDistrusted(trust[0]));
  for (const std::size_t honest : {1U, 2U, 3U}) EXPECT_LT(trust[honest].broken, 0.01);
  speak(30, "liar", -8.0);
  EXPECT_GT(At1(At(3100.0)), 0.8);  // Of which it says that it is not so.
  const std::string snapshot = dir_.File("s.db");
  ASSERT_THAT(store_.ExportSnapshot("a", snapshot), IsOk());
  MapStore on_vehicle = *MapStore::Open(snapshot, MapStore::Access::kReadOnly);
  EXPECT_EQ(on_vehicle.LoadAt("a", std::nullopt, At(3100.0))->groups()[0].probabilities(1),
            At1(At(3100.0)));

  ASSERT_THAT(store_.Exclude("a", {"", "liar", At(-1e6), "lies", {}}), IsOk());
  EXPECT_THAT(*store_.Trust("a"), SizeIs(3));
  ASSERT_THAT(store_.IncludeAll("a", {{"", "liar", {}, "", {}}}), IsOk());
  EXPECT_EQ((*store_.Trust("a"))[0].broken, trust[0].broken);
}

// The oracle is a store to which the run, or the vehicle, never came.
TEST_F(MappedEvidenceTest, WhatIsExcludedIsAsIfItHadNeverCome) {
  const CommitResult first = Map({0, 1, 2}, std::nullopt);
  ShiftReport honest = Report(first, 4);
  honest.vehicle = "truck 2";
  ShiftReport lie = Report(first, 5);
  lie.vehicle = "liar";
  lie.run_hash.clear();  // A live stream.
  for (const ShiftReport& report : {honest, lie}) ASSERT_THAT(store_.Return(report), IsOk());
  const double all = At1(At(900.0));

  MapStore never = OpenStore(dir_.File("never.db"));
  ASSERT_THAT(never.Commit("a", Content(2), {"", "", 0, {Run(0), Run(2)}}, Derived(std::nullopt)),
              IsOk());
  ASSERT_THAT(never.Return(honest), IsOk());
  ASSERT_THAT(store_.Exclude("a", {Hash(1), "", {}, "slipped", {}}), IsOk());
  ASSERT_THAT(store_.Exclude("a", {"", "liar", At(-1e6), "lies", {}}), IsOk());
  EXPECT_EQ(At1(At(900.0)),
            never.LoadAt("a", std::nullopt, At(900.0))->groups()[0].probabilities(1));
  EXPECT_EQ(store_.Evidence("a", first.version)->size(), 3u);
  EXPECT_THAT(*store_.ExcludedRunsOf("a", first.version), ElementsAre("run 1"));
  const std::vector<ReportSummary> reports = *store_.Reports("a");
  ASSERT_THAT(reports, SizeIs(2));
  EXPECT_THAT(reports[0].set_aside, IsEmpty());
  ASSERT_THAT(reports[1].set_aside, SizeIs(1));
  EXPECT_EQ(reports[1].set_aside[0].reason, SetAside::kExcluded);
  EXPECT_EQ((*store_.Exclusions("a"))[0].reason, "slipped");

  ASSERT_THAT(store_.IncludeAll("a", {{"", "liar", {}, "", {}}}), IsOk());
  EXPECT_THAT(store_.IncludeAll("a", {{"", "liar", {}, "", {}}}),
              StatusIs(StatusCode::kNotFound, "vehicle 'liar': is neither excluded nor held"));
  ASSERT_THAT(store_.IncludeAll("a", {{Hash(1), "", {}, "", {}}}), IsOk());
  EXPECT_EQ(At1(At(900.0)), all);
  // By the UUID of the live shift alone, and since a time after it.
  ASSERT_THAT(store_.Exclude("a", {lie.uuid, "", {}, "lies", {}}), IsOk());
  ASSERT_THAT(store_.Exclude("a", {"", "truck 2", At(10'000.0), "worn", {}}), IsOk());
  const double without = At1(At(900.0));
  EXPECT_NE(without, all);
  EXPECT_THAT(store_.Exclude("a", {lie.uuid, "", {}, "lies", {}}),
              StatusIs(StatusCode::kAlreadyExists, "is excluded already"));
  EXPECT_THAT(store_.Exclude("a", {"", "", {}, "why", {}}),
              StatusIs(StatusCode::kInvalidArgument, "either a run or a vehicle"));
  EXPECT_THAT(store_.Exclude("a", {Hash(2), "", {}, "", {}}),
              StatusIs(StatusCode::kInvalidArgument, "a reason"));
  EXPECT_THAT(store_.Exclude("a", {"run 9", "", {}, "why", {}}),
              StatusIs(StatusCode::kNotFound, "no run 'run 9'"));
  EXPECT_THAT(store_.Exclude("a", {"0000000", "", {}, "why", {}}),
              StatusIs(StatusCode::kInvalidArgument, "more than one run"));
  EXPECT_EQ(At1(At(900.0)), without);
}

// A UUID is the same in letters of either case, also of a run that has not come yet.
TEST_F(MappedEvidenceTest, ARunIsExcludedByItsUuidInCapitals) {
  const CommitResult map = Map({0}, std::nullopt);
  const double before = At1(At(900.0));
  ASSERT_THAT(store_.Exclude("a", {"0F8FAD5B-D9CB-469F-A165-70867728950E", "", {}, "test", {}}),
              IsOk());
  ShiftReport report = Report(map, 1);
  report.run_uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  ASSERT_THAT(store_.Return(report), IsOk());
  EXPECT_EQ(At1(At(900.0)), before);
  ASSERT_THAT(store_.IncludeAll("a", {{"0F8FAD5B-D9CB-469F-A165-70867728950E", "", {}, "", {}}}),
              IsOk());
  EXPECT_NE(At1(At(900.0)), before);
}

// An operator may know a run by any of its names before a report about it comes: a night names a
// log by its hash, a vehicle its report by a UUID. It may come back by any other name.
TEST_F(MappedEvidenceTest, ARunIsExcludedByEachOfItsNamesBeforeItComes) {
  const CommitResult map = Map({0}, std::nullopt);
  const double before = At1(At(2000.0));
  int runs = 0;
  for (const bool has_log : {true, false}) {
    for (std::size_t excluded = 0; excluded < 3; ++excluded) {
      for (std::size_t included = 0; included < 3; ++included) {
        if (!has_log && (excluded == 0 || included == 0)) continue;
        ShiftReport report = Report(map, ++runs);
        report.run_uuid = fmt::format("0f8fad5b-d9cb-469f-a165-70867728{:04}", runs);
        if (!has_log) report.run_hash = "";
        const std::array<std::string, 3> names{report.run_hash, report.run_uuid, report.uuid};
        SCOPED_TRACE(
            fmt::format("excluded as {}, included as {}", names[excluded], names[included]));
        ASSERT_THAT(store_.Exclude("a", {names[excluded], "", {}, "lies", {}}), IsOk());
        EXPECT_EQ(store_.Return(report)->set_aside[0].reason, SetAside::kExcluded);
        EXPECT_EQ(At1(At(2000.0)), before);
        ASSERT_THAT(store_.IncludeAll("a", {{names[included], "", {}, "", {}}}), IsOk());
        EXPECT_NE(At1(At(2000.0)), before);
        EXPECT_THAT(*store_.Exclusions("a"), SizeIs(runs - 1));
        ASSERT_THAT(store_.Exclude("a", {names[included], "", {}, "lies", {}}), IsOk());
        EXPECT_EQ(At1(At(2000.0)), before);
      }
    }
  }
}

// As by somebody who looks at the run while a night builds on it.
TEST_F(MappedEvidenceTest, ARunThatWasExcludedMeanwhileIsNotCommitted) {
  const CommitResult first = Map({0}, std::nullopt);
  const Provenance provenance{"", "", 0, {Run(1)}};
  for (const bool held : {false, true}) {
    ASSERT_THAT(store_.Exclude("a", {Hash(1), "", {}, "lies", held}), IsOk());
    EXPECT_THAT(store_.Commit("a", Content(2), provenance, Derived(first.version)),
                StatusIs(StatusCode::kAborted,
                         held ? "run 'run 1' was held since the build began: lies"
                              : "run 'run 1' was excluded since the build began: lies"));
    ASSERT_THAT(store_.IncludeAll("a", {{Hash(1), "", {}, "", {}}}), IsOk());
  }
  EXPECT_THAT(store_.Commit("a", Content(2), provenance, Derived(first.version)), IsOk());
}

// Two sites may give their logs the same names.
TEST_F(MappedEvidenceTest, ARunIsNamedWithinItsArea) {
  Map({0}, std::nullopt);
  RunRecord namesake = Run(1);
  namesake.name = Run(0).name;
  ASSERT_THAT(store_.Commit("b", Content(2), {"", "", 0, {namesake}}, Derived(std::nullopt)),
              IsOk());
  ASSERT_THAT(store_.Exclude("b", {namesake.name, "", {}, "lies", {}}), IsOk());
  EXPECT_THAT(*store_.Exclusions("a"), IsEmpty());
  EXPECT_EQ((*store_.Exclusions("b"))[0].run, Hash(1));
  EXPECT_THAT(store_.Exclude("b", {Run(2).name, "", {}, "lies", {}}),
              StatusIs(StatusCode::kNotFound, "no run"));
}

TEST_F(MappedEvidenceTest, ExclusionsOfOneCommandAreOne) {
  Map({0, 1, 2}, std::nullopt);
  const auto excluded = [&] { return store_.Exclusions("a")->size(); };
  const Exclusion first{Hash(0), "", {}, "slipped", {}};
  const Exclusion second{Hash(1), "", {}, "slipped", {}};
  // A run that is none, and one that is named twice.
  EXPECT_THAT(store_.ExcludeAll("a", {first, {"typo", "", {}, "slipped", {}}}),
              StatusIs(StatusCode::kNotFound, "no run 'typo'"));
  EXPECT_THAT(store_.ExcludeAll("a", {first, second, first}),
              StatusIs(StatusCode::kAlreadyExists, "is excluded already"));
  EXPECT_EQ(excluded(), 0u);
  ASSERT_THAT(store_.ExcludeAll("a", {first, second}), IsOk());
  EXPECT_EQ(excluded(), 2u);
  EXPECT_THAT(store_.IncludeAll("a", {first, {Hash(2), "", {}, "", {}}}),
              StatusIs(StatusCode::kNotFound, "is neither excluded nor held"));
  EXPECT_EQ(excluded(), 2u);
}

TEST_F(MappedEvidenceTest, ADryRunOfAnExclusionChecksAllAndWritesNothing) {
  Map({0, 1}, std::nullopt);
  const Exclusion run{Hash(1), "", {}, "slipped", {}};
  EXPECT_THAT(store_.Exclude("a", run, true), IsOk());
  EXPECT_THAT(*store_.Exclusions("a"), IsEmpty());
  EXPECT_THAT(store_.Exclude("a", {Hash(1), "", {}, "", {}}, true),
              StatusIs(StatusCode::kInvalidArgument, "expected a reason"));
  EXPECT_THAT(store_.IncludeAll("a", {run}, true),
              StatusIs(StatusCode::kNotFound, "is neither excluded nor held"));
  ASSERT_THAT(store_.Exclude("a", run), IsOk());
  EXPECT_THAT(store_.Exclude("a", run, true),
              StatusIs(StatusCode::kAlreadyExists, "is excluded already"));
  EXPECT_THAT(store_.IncludeAll("a", {run}, true), IsOk());
  EXPECT_THAT(*store_.Exclusions("a"), SizeIs(1));
}

TEST_F(MappedEvidenceTest, AnExclusionOfAVehicleCanBeginEarlier) {
  const CommitResult first = Map({0, 1}, std::nullopt);
  const std::string vehicle = Run(0).vehicle;
  ASSERT_EQ(Run(1).vehicle, vehicle);
  ASSERT_LT(Run(0).begin, Run(1).begin);
  ASSERT_THAT(store_.Exclude("a", {"", vehicle, Run(1).begin, "slips", {}}), IsOk());
  EXPECT_THAT(*store_.ExcludedRunsOf("a", first.version), ElementsAre("run 1"));
  EXPECT_THAT(store_.Exclude("a", {"", vehicle, Run(1).begin, "again", {}}),
              StatusIs(StatusCode::kAlreadyExists, "is excluded already"));
  ASSERT_THAT(store_.Exclude("a", {"", vehicle, At(-1e6), "slips for long", {}}), IsOk());
  EXPECT_THAT(*store_.ExcludedRunsOf("a", first.version), ElementsAre("run 0", "run 1"));
  EXPECT_THAT(*store_.Exclusions("a"), SizeIs(1));
  EXPECT_THAT(
      store_.IncludeAll("a", {{Hash(0), "", {}, "", {}}}),
      StatusIs(StatusCode::kNotFound, "only its vehicle is excluded or held, '" + vehicle + "'"));
  ASSERT_THAT(store_.IncludeAll("a", {{"", vehicle, {}, "", {}}}), IsOk());
  EXPECT_THAT(*store_.ExcludedRunsOf("a", first.version), IsEmpty());
}

// The oracle is the same run excluded.
TEST_F(MappedEvidenceTest, AHeldRunCountsForNothingAndItsVersionsStayGood) {
  const CommitResult first = Map({0, 1}, std::nullopt);
  const ShiftReport report = Report(first, 4);
  ASSERT_THAT(store_.Return(report), IsOk());
  const double all = At1(At(900.0));
  const Exclusion run{Hash(1), "", {}, "to be looked at", true};
  ASSERT_THAT(store_.Exclude("a", run), IsOk());
  ASSERT_THAT(store_.Exclude("a", {report.run_hash, "", {}, "too", true}), IsOk());
  EXPECT_THAT(store_.Exclude("a", run),
              StatusIs(StatusCode::kAlreadyExists, "is excluded or held already"));
  const double held = At1(At(900.0));
  EXPECT_NE(held, all);
  EXPECT_THAT(*store_.ExcludedRunsOf("a", first.version), IsEmpty());
  EXPECT_EQ(store_.Evidence("a", first.version)->size(), 1u);
  EXPECT_EQ((*store_.Reports("a"))[0].set_aside[0].reason, SetAside::kHeld);

  // The exclusion of its vehicle is not hidden by it, nor shortened by a hold of the vehicle.
  ASSERT_THAT(store_.Exclude("a", {"", "truck 1", At(-1e6), "slips", false}), IsOk());
  EXPECT_THAT(store_.Exclude("a", {"", "truck 1", At(50.0), "again", true}),
              StatusIs(StatusCode::kAlreadyExists, "is excluded or held already"));
  EXPECT_THAT(*store_.ExcludedRunsOf("a", first.version), ElementsAre("run 0", "run 1"));
  ASSERT_THAT(store_.IncludeAll("a", {{"", "truck 1", {}, "", {}}}), IsOk());
  ASSERT_THAT(store_.Exclude("a", {"", "truck 1", At(-1e6), "slips", true}), IsOk());
  ASSERT_THAT(store_.Exclude("a", {"", "truck 1", At(50.0), "slips", false}), IsOk());
  EXPECT_THAT(*store_.ExcludedRunsOf("a", first.version), ElementsAre("run 0", "run 1"));
  ASSERT_THAT(store_.IncludeAll("a", {{"", "truck 1", {}, "", {}}}), IsOk());
  EXPECT_EQ(At1(At(900.0)), held);

  // Decided one way, and the other.
  ASSERT_THAT(store_.Exclude("a", {Hash(1), "", {}, "slipped", false}), IsOk());
  ASSERT_THAT(*store_.Exclusions("a"), SizeIs(2));
  EXPECT_THAT(*store_.ExcludedRunsOf("a", first.version), ElementsAre("run 1"));
  EXPECT_EQ(At1(At(900.0)), held);
  ASSERT_THAT(store_.IncludeAll("a", {{report.run_hash, "", {}, "", {}}}), IsOk());
  ASSERT_THAT(store_.IncludeAll("a", {{Hash(1), "", {}, "", {}}}), IsOk());
  EXPECT_THAT(*store_.Exclusions("a"), IsEmpty());
  EXPECT_EQ(At1(At(900.0)), all);
}

TEST_F(MappedEvidenceTest, VisibilityIsTheSumOverTheRunsOfALine) {
  const auto run = [&](int index, int seen) {
    RunRecord record = Run(index);
    Visibility scans;
    scans.seen[2] = seen;
    scans.missed[7] = 1;
    record.visibility = {{Signature("A"), ModeNumber(1), scans}};
    return record;
  };
  const auto map = [&](std::vector<RunRecord> runs, std::optional<VersionNumber> parent) {
    return *store_.Commit("a", Content(4), {"", "", 0, std::move(runs)}, Derived(parent));
  };
  const CommitResult first = map({run(0, 1), run(1, 10)}, std::nullopt);
  const CommitResult second = map({run(2, 100)}, first.version);
  CommitOptions other = Derived(first.version);
  other.publish = false;
  ASSERT_THAT(store_.Commit("a", Content(4), {"", "", 0, {run(3, 1000)}}, other), IsOk());
  const auto expect =
      [&](VersionNumber version, const std::set<std::string>& without, int seen, int runs) {
        const std::vector<ModeVisibility> all = *store_.MappedVisibility("a", version, without);
        ASSERT_THAT(all, SizeIs(1));
        EXPECT_EQ(all[0].mode, ModeNumber(1));
        EXPECT_EQ(all[0].scans.seen[2], seen);
        EXPECT_EQ(all[0].scans.missed[7], runs);
      };
  expect(first.version, {}, 11, 2);
  expect(second.version, {}, 111, 3);
  expect(second.version, {Hash(0)}, 110, 2);
  ASSERT_THAT(store_.Exclude("a", {Hash(1), "", {}, "slipped", {}}), IsOk());
  expect(second.version, {}, 101, 2);
  EXPECT_TRUE(VerifyStore(dir_.File("a.db"))->clean());
}

// A version says of a run of its parent what that could not say: of the versions before it, it says
// nothing, and it goes with the run.
TEST_F(MappedEvidenceTest, OlderRunsSayMoreOfNewModes) {
  const CommitResult first = Map({0}, std::nullopt);
  Provenance provenance;
  provenance.runs = {Run(1)};
  RunRecord older = Run(0);
  older.evidence = {TwoStateEvidence(At(12.0), At(40.0), 0.0, -5.0)};
  provenance.older = {older};
  const auto second = store_.Commit("a", Content(1), provenance, Derived(first.version));
  ASSERT_THAT(second, IsOk());
  EXPECT_THAT(*store_.Evidence("a", first.version), SizeIs(1));
  EXPECT_THAT(*store_.Evidence("a", second->version), SizeIs(3));
  EXPECT_LT(At1(At(200.0), second->version), ByHand({0, 1}, 70.0) - 0.1);
  EXPECT_THAT(store_.LoadProvenance("a", second->version)->older, IsEmpty());
  EXPECT_TRUE(VerifyStore(dir_.File("a.db"))->clean());
  ASSERT_THAT(store_.Exclude("a", {Hash(0), "", {}, "test"}), IsOk());
  EXPECT_THAT(*store_.Evidence("a", second->version), SizeIs(1));

  provenance.runs = {Run(2)};
  provenance.older = {Run(7)};
  EXPECT_THAT(store_.Commit("a", Content(2), provenance, Derived(second->version)),
              StatusIs(StatusCode::kInvalidArgument, "run 'run 7' is of no ancestor"));
}

TEST_F(MappedEvidenceTest, EvidenceThatDoesNotFitIsRefusedWhole) {
  const CommitResult first = Map({0}, std::nullopt);
  const auto refused = [&](const RunRecord& run, const CommitOptions& options, const char* why) {
    EXPECT_THAT(store_.Commit("a", Content(5), {"", "", 0, {run}}, options),
                StatusIs(StatusCode::kInvalidArgument, why));
  };
  const CommitOptions derived = Derived(first.version);
  RunRecord run = Run(0);
  refused(run, derived, "run 'run 0' is mapped already");
  CommitOptions states = derived;
  states.states_probabilities = true;
  refused(Run(1), states, "beside a statement");
  run = Run(1);
  run.evidence[0].signature = Signature("B");
  refused(run, derived, "evidence of 'B': the map does not have it");
  run = Run(1);
  run.evidence[0].modes.push_back({ModeNumber(2), 0.0});
  refused(run, derived, "a mode that the map does not have");
  run = Run(1);
  run.evidence[0].modes[1].log_likelihood = 51.0;
  refused(run, derived, "too far apart");
  run = Run(1);
  run.evidence[0].modes[1].log_likelihood = std::nan("");
  refused(run, derived, "finite");
  run = Run(1);
  run.evidence[0].end = run.end + Duration(1);
  refused(run, derived, "not within the run");
  EXPECT_EQ(store_.Versions("a")->size(), 1u);
}

}  // namespace
}  // namespace shiftmap::testing

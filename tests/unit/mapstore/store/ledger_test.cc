// SPDX-License-Identifier: Apache-2.0
//
// Shift reports, and the probabilities that the ledger implies.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "mapstore/maintenance/compact.h"
#include "mapstore/maintenance/verify.h"
#include "mapstore/map_store.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::IsEmpty;
using ::testing::SizeIs;

auto IsAside(SetAside reason, int rows) {
  return AllOf(Field(&SetAsideRows::reason, reason), Field(&SetAsideRows::rows, rows));
}

constexpr double kRate = 1e-3;

// P(mode 1) of the chain with one mode: relaxes to 1/2 at rate 2 λ.
double Relaxed(double probability, double elapsed_s) {
  return 0.5 + (probability - 0.5) * std::exp(-2.0 * kRate * elapsed_s);
}

// Bayes with a log-likelihood ratio of mode 1 over absent.
double Bayes(double probability, double log_ratio) {
  return probability * std::exp(log_ratio) /
         (probability * std::exp(log_ratio) + 1.0 - probability);
}

// A vehicle's turn by hand, from P(mode 1) before it on.
struct Turn {
  explicit Turn(double known) : right(known), mistaken(known) {}

  Turn& See(double log_ratio) {
    const auto evidence = [&](double p) { return p * std::exp(log_ratio) + 1.0 - p; };
    odds *= evidence(own) / evidence(right);
    own = Bayes(own, log_ratio);
    right = Bayes(right, log_ratio);
    return *this;
  }

  Turn& Wait(double elapsed_s) {
    for (double* p : {&right, &mistaken, &own}) *p = Relaxed(*p, elapsed_s);
    return *this;
  }

  double P() const { return (right + odds * mistaken) / (1.0 + odds); }

  double right;
  double mistaken;
  double own = 0.5;
  double odds = kMistakeProbability / (1.0 - kMistakeProbability);
};

// The one visit of a turn.
double Updated(double probability, double log_ratio) {
  return Turn(probability).See(log_ratio).P();
}

class LedgerTest : public ::testing::Test {
 protected:
  TempDir dir_;
  MapStore store_ = OpenStore(dir_.File("a.db"));
  CommitResult version_ = *store_.Commit("a", TwoStateContent(kRate, 0.7, At(0.0)), {}, {});

  ReturnResult MustReturn(const ShiftReport& report) {
    const StatusOr<ReturnResult> result = store_.Return(report);
    EXPECT_THAT(result, IsOk());
    return *result;
  }

  // P(mode 1) at a time.
  double ProbabilityAt(std::optional<Stamp> at,
                       std::optional<VersionNumber> version = std::nullopt) {
    const StatusOr<MapSnapshot> snapshot = store_.LoadAt("a", version, at);
    EXPECT_THAT(snapshot, IsOk());
    return snapshot->groups()[0].probabilities(1);
  }
};

TEST_F(LedgerTest, WithoutReportsTheChainRelaxes) {
  EXPECT_DOUBLE_EQ(ProbabilityAt(std::nullopt), 0.7);
  EXPECT_EQ(store_.LoadAt("a")->stamp(), At(0.0));
  EXPECT_DOUBLE_EQ(ProbabilityAt(At(-100.0)), 0.7);
  EXPECT_EQ(store_.LoadAt("a", std::nullopt, At(-100.0))->stamp(), At(0.0));
  EXPECT_NEAR(ProbabilityAt(At(500.0)), Relaxed(0.7, 500.0), 1e-12);
  EXPECT_EQ(store_.LoadAt("a", std::nullopt, At(500.0))->stamp(), At(500.0));
}

TEST_F(LedgerTest, ProbabilitiesFollowTheTwoStateChainByHand) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.evidence = {TwoStateEvidence(At(100.0), At(150.0), 0.0, -1.5),
                     TwoStateEvidence(At(400.0), At(420.0), -2.0, 0.25)};
  EXPECT_EQ(MustReturn(report).evidence_rows, 2);

  Turn turn(Relaxed(0.7, 100.0));
  const double first = turn.See(-1.5).P();
  const double second = turn.Wait(250.0).See(2.25).P();
  EXPECT_NEAR(ProbabilityAt(At(50.0)), Relaxed(0.7, 50.0), 1e-12);
  EXPECT_NEAR(ProbabilityAt(At(150.0)), first, 1e-12);
  EXPECT_NEAR(ProbabilityAt(At(300.0)), Relaxed(first, 150.0), 1e-12);
  EXPECT_NEAR(ProbabilityAt(std::nullopt), second, 1e-12);
  EXPECT_EQ(store_.LoadAt("a")->stamp(), At(420.0));
  EXPECT_NEAR(ProbabilityAt(At(1000.0)), Relaxed(second, 580.0), 1e-12);
  // The committed version stays as it was.
  EXPECT_DOUBLE_EQ(store_.LoadVersion("a", version_.version)->groups()[0].probabilities(1), 0.7);
}

TEST_F(LedgerTest, AStatementIsEvidenceBesideOlderVisits) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.evidence = {TwoStateEvidence(At(-900.0), At(-800.0), 0.0, 1.0)};
  MustReturn(report);
  // The chain forgets the visit in the 800 s until the statement.
  const double at_statement = Bayes(Relaxed(Updated(0.5, 1.0), 800.0), std::log(0.7 / 0.3));
  EXPECT_NEAR(ProbabilityAt(std::nullopt), at_statement, 1e-12);
  EXPECT_NEAR(ProbabilityAt(At(10.0)), Relaxed(at_statement, 10.0), 1e-12);
  // For an earlier time it is that at the stamp, without visits that began later than asked for.
  EXPECT_NEAR(ProbabilityAt(At(-700.0)), at_statement, 1e-12);
  EXPECT_NEAR(ProbabilityAt(At(-950.0)), 0.7, 1e-12);

  // Time passes between old visits as between others.
  ShiftReport second = EmptyReport(version_, "a", 2);
  second.evidence = {TwoStateEvidence(At(-500.0), At(-400.0), 2.0, 0.0)};
  MustReturn(second);
  const double visits = Turn(0.5).See(1.0).Wait(300.0).See(-2.0).P();
  EXPECT_NEAR(
      ProbabilityAt(std::nullopt), Bayes(Relaxed(visits, 400.0), std::log(0.7 / 0.3)), 1e-12);
}

TEST_F(LedgerTest, ArrivalOrderDoesNotMatter) {
  std::mt19937_64 random(TestSeed(7));
  std::uniform_real_distribution<double> value(-3.0, 3.0);
  std::vector<ShiftReport> reports;
  for (int i = 0; i < 6; ++i) {
    reports.push_back(EmptyReport(version_, "a", i));
    // Visits of different vehicles overlap, and two share their times.
    const double begin = 40.0 * (i / 2);
    reports.back().evidence = {
        TwoStateEvidence(At(begin), At(begin + 60.0), value(random), value(random))};
  }
  std::vector<double> results;
  for (int round = 0; round < 4; ++round) {
    std::shuffle(reports.begin(), reports.end(), random);
    MapStore store = OpenStore(dir_.File("round" + std::to_string(round)));
    ASSERT_THAT(store.Commit("a", TwoStateContent(kRate, 0.7, At(0.0)), {}, {}), IsOk());
    for (const ShiftReport& report : reports) ASSERT_THAT(store.Return(report), IsOk());
    results.push_back(store.LoadAt("a")->groups()[0].probabilities(1));
    EXPECT_NEAR(results.back(), results.front(), 1e-12);
  }
}

TEST_F(LedgerTest, ReportCountsOnce) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.uuid = "0000000a-0000-4000-8000-000000000001";
  report.evidence = {TwoStateEvidence(At(1.0), At(2.0), 0.0, 3.0)};
  UnmappedSighting sighting;
  sighting.cov_p_map_landmark.setIdentity();
  sighting.count = 1;
  sighting.first = sighting.last = At(1.0);
  report.sightings = {sighting};
  EXPECT_FALSE(MustReturn(report).duplicate);
  const double once = ProbabilityAt(std::nullopt);
  report.uuid = "0000000A-0000-4000-8000-000000000001";
  const ReturnResult again = MustReturn(report);
  EXPECT_TRUE(again.duplicate);
  EXPECT_EQ(again.evidence_rows, 0);
  EXPECT_EQ(ProbabilityAt(std::nullopt), once);
  EXPECT_THAT(*store_.Sightings("a"), SizeIs(1));
}

TEST_F(LedgerTest, ReportMustFitAVersion) {
  ShiftReport report = EmptyReport(version_, "nowhere", 1);
  EXPECT_THAT(store_.Return(report), StatusIs(StatusCode::kNotFound, "'nowhere'"));
  report = EmptyReport(version_, "a", 1);
  report.version = VersionNumber(9);
  EXPECT_THAT(store_.Return(report), StatusIs(StatusCode::kNotFound, "no version 9"));
  report = EmptyReport(version_, "a", 1);
  report.content_hash = std::string(64, 'b');
  EXPECT_THAT(store_.Return(report), StatusIs(StatusCode::kInvalidArgument, "bbbb"));
}

TEST_F(LedgerTest, MalformedReportIsRefusedWhole) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.evidence = {TwoStateEvidence(At(1.0), At(2.0), 0.0, 1.0),
                     TwoStateEvidence(At(5.0), At(4.0), 0.0, 1.0)};
  EXPECT_THAT(store_.Return(report), StatusIs(StatusCode::kInvalidArgument, "expected in order"));
  report.evidence[1] = TwoStateEvidence(At(4.0), At(5.0), 0.0, std::nan(""));
  EXPECT_THAT(store_.Return(report), StatusIs(StatusCode::kInvalidArgument, "finite"));
  report.evidence[1] = report.evidence[0];
  EXPECT_THAT(store_.Return(report),
              StatusIs(StatusCode::kInvalidArgument, "another visit of 'A'"));
  report.evidence[1].modes.erase(report.evidence[1].modes.begin());
  EXPECT_THAT(store_.Return(report), StatusIs(StatusCode::kInvalidArgument, "begin with mode 0"));
  EXPECT_DOUBLE_EQ(ProbabilityAt(At(100.0)), Relaxed(0.7, 100.0));
}

TEST_F(LedgerTest, RowsForWhatTheMapDoesNotHaveAreKeptAsideWithAReason) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.evidence = {TwoStateEvidence(At(0.0), At(0.0), 0.0, 1.0),
                     TwoStateEvidence(At(5.0), At(5.0), 0.0, 1.0)};
  report.evidence[0].modes.push_back({ModeNumber(7), 0.5});
  report.evidence[1].modes.push_back({ModeNumber(7), 40.0});
  VisitEvidence stranger = TwoStateEvidence(At(0.0), At(0.0), 0.0, 1.0);
  stranger.signature = Signature("B");
  report.evidence.push_back(stranger);
  const ReturnResult result = MustReturn(report);
  EXPECT_EQ(result.evidence_rows, 3);
  EXPECT_THAT(result.set_aside,
              ElementsAre(IsAside(SetAside::kNoLandmark, 1), IsAside(SetAside::kNoMode, 1)));
  EXPECT_NEAR(ProbabilityAt(std::nullopt), Updated(0.7, 1.0), 1e-12);
  EXPECT_EQ(store_.LoadAt("a")->stamp(), At(0.0));
  const std::vector<ReportSummary> reports = *store_.Reports("a");
  ASSERT_THAT(reports, SizeIs(1));
  EXPECT_EQ(reports[0].evidence_rows, 3);
  EXPECT_THAT(reports[0].set_aside,
              ElementsAre(IsAside(SetAside::kNoLandmark, 1), IsAside(SetAside::kNoMode, 1)));
}

TEST_F(LedgerTest, ModesThatTheVehicleDidNotKnowGetItsValueForAbsent) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.evidence = {TwoStateEvidence(At(0.0), At(0.0), 2.0, 0.0)};
  report.evidence[0].modes.pop_back();
  MustReturn(report);
  EXPECT_NEAR(ProbabilityAt(At(0.0)), 0.7, 1e-12);
}

TEST_F(LedgerTest, AncestorsReportsCountAfterTheVersionsStamp) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.evidence = {TwoStateEvidence(At(100.0), At(110.0), 0.0, 5.0),
                     TwoStateEvidence(At(1100.0), At(1100.0), 0.0, -2.0)};
  MustReturn(report);
  const MapContent next = TwoStateContent(kRate, 0.6, At(1000.0));
  const CommitResult child = *store_.Commit("a", next, {}, {version_.version, true});
  EXPECT_NEAR(ProbabilityAt(std::nullopt), Updated(Relaxed(0.6, 100.0), -2.0), 1e-12);
  // A child's report counts for its parent, whose modes it has; nobody's for a stranger.
  ShiftReport on_child = EmptyReport(child, "a", 2);
  on_child.evidence = {TwoStateEvidence(At(1500.0), At(1500.0), 0.0, 1.0)};
  MustReturn(on_child);
  EXPECT_EQ(store_.LoadAt("a", version_.version)->stamp(), At(1500.0));
  EXPECT_EQ(store_.LoadAt("a", child.version)->stamp(), At(1500.0));
  const CommitResult stranger = *store_.Commit("a", next, {}, {std::nullopt, true});
  EXPECT_NEAR(ProbabilityAt(std::nullopt, stranger.version), 0.6, 1e-12);
}

// A vehicle that was still on the parent reports a visit from before the child's stamp.
TEST_F(LedgerTest, LateReportAgainstAnAncestorIsCarriedOver) {
  const CommitResult child =
      *store_.Commit("a", TwoStateContent(kRate, 0.6, At(1000.0)), {}, {version_.version, true});
  ShiftReport late = EmptyReport(version_, "a", 1);
  late.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 3.0)};
  EXPECT_THAT(MustReturn(late).set_aside, IsEmpty());
  // p(late | mode at the stamp), 100 s later: the chain may have left in between.
  const double mode = Relaxed(Updated(0.5, 3.0), 100.0);
  const double expected = 0.6 * mode / (0.6 * mode + 0.4 * (1.0 - mode));
  EXPECT_NEAR(ProbabilityAt(std::nullopt, child.version), expected, 1e-12);
  EXPECT_EQ(store_.LoadAt("a")->stamp(), At(1000.0));
  // Time goes on from there, and the report is what it always was for the version it was made on.
  EXPECT_NEAR(ProbabilityAt(At(1500.0), child.version), Relaxed(expected, 500.0), 1e-12);
  EXPECT_NEAR(ProbabilityAt(At(900.0), version_.version), Updated(Relaxed(0.7, 800.0), 3.0), 1e-12);
}

// The mapper read the ledger, then a report came, then it committed: the report is not lost.
TEST_F(LedgerTest, ReportBetweenReadingThePriorAndCommittingCounts) {
  const LedgerPosition position = store_.LoadAt("a")->ledger_position();
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 3.0)};
  MustReturn(report);
  const MapContent next = TwoStateContent(kRate, 0.6, At(1000.0));
  const CommitResult read_before =
      *store_.Commit("a", next, {}, {version_.version, false, position});
  const CommitResult read_after = *store_.Commit(
      "a", next, {}, {version_.version, false, store_.LoadAt("a")->ledger_position()});
  EXPECT_GT(ProbabilityAt(std::nullopt, read_before.version), 0.9);
  EXPECT_DOUBLE_EQ(ProbabilityAt(std::nullopt, read_after.version), 0.6);
  EXPECT_THAT((*store_.Reports("a", read_after.version))[0].set_aside,
              ElementsAre(IsAside(SetAside::kInMap, 1)));
}

TEST_F(LedgerTest, RunThatTheMapWasBuiltFromDoesNotCountAgain) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.run_hash = std::string(64, 'a');
  report.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 3.0)};
  Provenance provenance;
  provenance.runs = {{"run", report.run_hash, "truck 1", At(0.0), At(1000.0), {}}};
  const MapContent next = TwoStateContent(kRate, 0.6, At(1000.0));
  const CommitResult child = *store_.Commit("a", next, provenance, {version_.version, true});
  EXPECT_THAT(MustReturn(report).set_aside, ElementsAre(IsAside(SetAside::kRunInMap, 1)));
  EXPECT_DOUBLE_EQ(ProbabilityAt(std::nullopt, child.version), 0.6);
  EXPECT_NEAR(ProbabilityAt(At(900.0), version_.version), Updated(Relaxed(0.7, 800.0), 3.0), 1e-12);
  // The same when the report comes first, but the mapper did not look at the ledger.
  const CommitResult other =
      *store_.Commit("a", next, provenance, {version_.version, false, LedgerPosition(0)});
  EXPECT_DOUBLE_EQ(ProbabilityAt(std::nullopt, other.version), 0.6);
}

TEST_F(LedgerTest, OfTwoReportsAboutOneRunOneCountsWhicheverCameFirst) {
  ShiftReport first = EmptyReport(version_, "a", 1);
  ShiftReport second = EmptyReport(version_, "a", 2);
  first.run_hash = second.run_hash = std::string(64, 'b');
  first.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 3.0)};
  second.evidence = {TwoStateEvidence(At(810.0), At(890.0), 0.0, 2.0)};
  const double expected = Updated(Relaxed(0.7, 800.0), 3.0);
  EXPECT_THAT(MustReturn(second).set_aside, IsEmpty());
  MustReturn(first);
  EXPECT_NEAR(ProbabilityAt(std::nullopt), expected, 1e-12);

  MapStore other = OpenStore(dir_.File("other.db"));
  ASSERT_THAT(other.Commit("a", TwoStateContent(kRate, 0.7, At(0.0)), {}, {}), IsOk());
  ASSERT_THAT(other.Return(first), IsOk());
  EXPECT_THAT(other.Return(second)->set_aside, ElementsAre(IsAside(SetAside::kSameRun, 1)));
  EXPECT_NEAR(other.LoadAt("a")->groups()[0].probabilities(1), expected, 1e-12);
}

// Without a UUID a copy of a log that was cut off is known by its vehicle and its begin.
TEST_F(LedgerTest, OfReportsAboutCopiesOfALogTheLongestCountsWhicheverCameFirst) {
  ShiftReport cut = EmptyReport(version_, "a", 1);
  ShiftReport whole = EmptyReport(version_, "a", 2);
  whole.begin = cut.begin;
  cut.end = At(1000.0);
  cut.run_hash = std::string(64, 'b');
  whole.run_hash = std::string(64, 'c');
  cut.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 3.0)};
  whole.evidence = cut.evidence;
  whole.evidence.push_back(TwoStateEvidence(At(1100.0), At(1200.0), 0.0, 2.0));
  const double expected = Turn(Relaxed(0.7, 800.0)).See(3.0).Wait(200.0).See(2.0).P();
  EXPECT_THAT(MustReturn(whole).set_aside, IsEmpty());
  EXPECT_THAT(MustReturn(cut).set_aside, ElementsAre(IsAside(SetAside::kSameRun, 1)));
  EXPECT_NEAR(ProbabilityAt(std::nullopt), expected, 1e-12);

  MapStore other = OpenStore(dir_.File("other.db"));
  ASSERT_THAT(other.Commit("a", TwoStateContent(kRate, 0.7, At(0.0)), {}, {}), IsOk());
  ASSERT_THAT(other.Return(cut), IsOk());
  EXPECT_THAT(other.Return(whole)->set_aside, IsEmpty());
  EXPECT_NEAR(other.LoadAt("a")->groups()[0].probabilities(1), expected, 1e-12);

  // Not those of two runs: of another vehicle, of two UUIDs, live, or of a clock that was not set.
  const auto expect_two = [&](const auto& change) {
    ShiftReport another = whole;
    another.uuid.back() = '3';
    ShiftReport first = cut;
    change(&first, &another);
    const TempDir dir;
    MapStore fresh = OpenStore(dir.File("fresh.db"));
    ASSERT_THAT(fresh.Commit("a", TwoStateContent(kRate, 0.7, At(0.0)), {}, {}), IsOk());
    ASSERT_THAT(fresh.Return(first), IsOk());
    EXPECT_THAT(fresh.Return(another)->set_aside, IsEmpty());
  };
  expect_two([](ShiftReport*, ShiftReport* b) { b->vehicle = "truck 2"; });
  expect_two([](ShiftReport*, ShiftReport* b) { b->begin += Duration(1); });
  expect_two([](ShiftReport* a, ShiftReport* b) {
    a->run_uuid = "00000000-0000-4000-8000-00000000000a";
    b->run_uuid = "00000000-0000-4000-8000-00000000000b";
  });
  expect_two([](ShiftReport*, ShiftReport* b) { b->run_hash.clear(); });
  expect_two([](ShiftReport* a, ShiftReport* b) { a->begin = b->begin = Stamp(); });
}

TEST_F(LedgerTest, AReportAboutACopyOfALogThatIsExcludedCounts) {
  ShiftReport cut = EmptyReport(version_, "a", 1);
  ShiftReport whole = EmptyReport(version_, "a", 2);
  whole.begin = cut.begin;
  cut.end = At(1000.0);
  cut.run_hash = std::string(64, 'b');
  whole.run_hash = std::string(64, 'c');
  cut.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 3.0)};
  whole.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 2.0)};
  MustReturn(whole);
  EXPECT_THAT(MustReturn(cut).set_aside, ElementsAre(IsAside(SetAside::kSameRun, 1)));
  ASSERT_THAT(store_.Exclude("a", {whole.run_hash, "", {}, "damaged", {}}), IsOk());
  EXPECT_NEAR(ProbabilityAt(std::nullopt), Updated(Relaxed(0.7, 800.0), 3.0), 1e-12);
  ASSERT_THAT(store_.IncludeAll("a", {{whole.run_hash, "", {}, "", {}}}), IsOk());
  EXPECT_NEAR(ProbabilityAt(std::nullopt), Updated(Relaxed(0.7, 800.0), 2.0), 1e-12);
}

// Whatever comes before what: two copies of a log, the exclusion of the longest, a compaction.
TEST_F(LedgerTest, TheLongestCopyOfALogCountsInEveryOrder) {
  const double value = Relaxed(0.7, 800.0);
  std::array<int, 4> steps{0, 1, 2, 3};
  int orders = 0;
  do {
    const TempDir dir;
    const std::string path = dir.File("a.db");
    MapStore store = OpenStore(path);
    const CommitResult first = *store.Commit("a", TwoStateContent(kRate, 0.7, At(0.0)), {}, {});
    CommitOptions options;
    options.parent = first.version;
    options.states_probabilities = false;
    const CommitResult second =
        *store.Commit("a", TwoStateContent(kRate, 0.7, At(0.0)), {}, options);
    // The longer a copy, the newer its version and the higher its UUID.
    std::array<ShiftReport, 2> copies{EmptyReport(first, "a", 1), EmptyReport(second, "a", 2)};
    for (int i = 0; i < 2; ++i) {
      ShiftReport& copy = copies[static_cast<std::size_t>(i)];
      copy.begin = copies[0].begin;
      copy.end = At(1000.0 + i);
      copy.run_hash = std::string(64, static_cast<char>('b' + i));
      copy.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 1.0 + i)};
    }
    const std::string longest = copies[1].run_hash;
    for (const int step : steps) {
      if (step < 2) {
        ASSERT_THAT(store.Return(copies[static_cast<std::size_t>(step)]), IsOk());
      } else if (step == 2) {
        ASSERT_THAT(store.Exclude("a", {longest, "", {}, "damaged", {}}), IsOk());
      } else {
        RetentionPolicy policy;
        policy.keep_versions = 1;
        policy.evidence_before = At(5000.0);
        ASSERT_THAT(CompactStore(path, policy, false), IsOk());
      }
    }
    const auto probability = [&] {
      return store.LoadAt("a", std::nullopt, At(900.0))->groups()[0].probabilities(1);
    };
    EXPECT_NEAR(probability(), Updated(value, 1.0), 1e-12);
    ASSERT_THAT(store.IncludeAll("a", {{longest, "", {}, "", {}}}), IsOk());
    EXPECT_NEAR(probability(), Updated(value, 2.0), 1e-12);
    const StatusOr<VerifyResult> verified = VerifyStore(path);
    ASSERT_THAT(verified, IsOk());
    EXPECT_THAT(verified->defects, IsEmpty());
    ++orders;
  } while (std::next_permutation(steps.begin(), steps.end()));
  EXPECT_EQ(orders, 24);
}

TEST_F(LedgerTest, AReportAboutACopyOfAMappedLogDoesNotCount) {
  ShiftReport cut = EmptyReport(version_, "a", 1);
  cut.run_hash = std::string(64, 'b');
  cut.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 3.0)};
  RunRecord run{"run", std::string(64, 'c'), cut.vehicle, cut.begin, At(1000.0), {}};
  run.evidence = {TwoStateEvidence(At(810.0), At(890.0), 0.0, 2.0)};
  Provenance provenance;
  provenance.runs = {run};
  CommitOptions options;
  options.parent = version_.version;
  options.states_probabilities = false;
  const auto map = [&](MapStore& store) {
    ASSERT_THAT(store.Commit("a", TwoStateContent(kRate, 0.7, At(1000.0)), provenance, options),
                IsOk());
  };
  map(store_);
  EXPECT_THAT(MustReturn(cut).set_aside, ElementsAre(IsAside(SetAside::kRunInMap, 1)));

  MapStore other = OpenStore(dir_.File("other.db"));
  ASSERT_THAT(other.Commit("a", TwoStateContent(kRate, 0.7, At(0.0)), {}, {}), IsOk());
  ASSERT_THAT(other.Return(cut), IsOk());
  map(other);
  EXPECT_THAT((*other.Reports("a"))[0].set_aside, ElementsAre(IsAside(SetAside::kRunInMap, 1)));
  const StatusOr<VerifyResult> verified = VerifyStore(dir_.File("other.db"));
  ASSERT_THAT(verified, IsOk());
  EXPECT_THAT(verified->defects, IsEmpty());
}

// A version is rolled back and the next one is of another line: a log that was localized on the
// first counts by what is reported against the second. Whichever comes first, each version counts
// the first one that is of its line.
TEST_F(LedgerTest, OfReportsAboutARunEveryLineCountsItsOwnFirst) {
  CommitOptions options;
  options.parent = version_.version;
  options.states_probabilities = false;
  const auto commit = [&](MapStore& store) {
    const CommitResult bad = *store.Commit("a", TwoStateContent(kRate, 0.7, At(1.0)), {}, options);
    EXPECT_THAT(store.Rollback("a"), IsOk());
    const CommitResult good = *store.Commit("a", TwoStateContent(kRate, 0.7, At(2.0)), {}, options);
    return std::make_pair(bad, good);
  };
  MapStore other = OpenStore(dir_.File("other.db"));
  ASSERT_THAT(other.Commit("a", TwoStateContent(kRate, 0.7, At(0.0)), {}, {}), IsOk());
  const auto [bad, good] = commit(store_);
  commit(other);
  ShiftReport first = EmptyReport(bad, "a", 1);
  ShiftReport second = EmptyReport(good, "a", 2);
  ShiftReport third = EmptyReport(good, "a", 3);
  first.run_hash = second.run_hash = third.run_hash = std::string(64, 'b');
  first.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 3.0)};
  second.evidence = third.evidence = {TwoStateEvidence(At(810.0), At(890.0), 0.0, -2.0)};
  third.evidence[0].modes[1].log_likelihood = 1.0;

  EXPECT_THAT(MustReturn(first).set_aside, ElementsAre(IsAside(SetAside::kOtherLine, 1)));
  EXPECT_THAT(MustReturn(second).set_aside, IsEmpty());
  EXPECT_THAT(MustReturn(third).set_aside, ElementsAre(IsAside(SetAside::kSameRun, 1)));
  for (const ShiftReport& report : {third, second, first}) {
    ASSERT_THAT(other.Return(report), IsOk());
  }
  const double by_first = Relaxed(Updated(Relaxed(0.7, 800.0), 3.0), 100.0);
  const double by_second = Relaxed(Updated(Relaxed(0.7, 810.0), -2.0), 110.0);
  EXPECT_NEAR(ProbabilityAt(At(1000.0), version_.version), by_first, 1e-12);
  EXPECT_NEAR(ProbabilityAt(At(1000.0), bad.version), by_first, 1e-12);
  EXPECT_NEAR(ProbabilityAt(At(1000.0), good.version), by_second, 1e-12);
  for (const CommitResult& version : {version_, bad, good}) {
    EXPECT_EQ(other.LoadAt("a", version.version, At(1000.0))->groups()[0].probabilities,
              store_.LoadAt("a", version.version, At(1000.0))->groups()[0].probabilities);
  }
  ASSERT_THAT(store_.ExportSnapshot("a", dir_.File("s.db")), IsOk());
  for (const std::string& file : {dir_.File("a.db"), dir_.File("other.db"), dir_.File("s.db")}) {
    const StatusOr<VerifyResult> verified = VerifyStore(file);
    ASSERT_THAT(verified, IsOk());
    EXPECT_TRUE(verified->clean()) << file << ": " << verified->defects[0].problem;
  }
}

// A vehicle reports its shift and leaves the log, which is localized again, and then mapped: what
// it says counts once, whichever comes first, and as the map has it.
TEST_F(LedgerTest, ALiveShiftAndItsLogAreOneRun) {
  const std::string uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  ShiftReport live = EmptyReport(version_, "a", 1);
  live.uuid = uuid;  // Its log has that.
  ShiftReport again = EmptyReport(version_, "a", 2);
  again.run_uuid = "0F8FAD5B-D9CB-469F-A165-70867728950E";
  again.run_hash = std::string(64, 'b');
  // A localizer that does not know of run UUIDs yet.
  ShiftReport old = EmptyReport(version_, "a", 3);
  old.run_hash = again.run_hash;
  live.evidence = {TwoStateEvidence(At(800.0), At(900.0), 0.0, 3.0)};
  again.evidence = old.evidence = {TwoStateEvidence(At(810.0), At(890.0), 0.0, 2.0)};
  EXPECT_THAT(MustReturn(again).set_aside, IsEmpty());
  MustReturn(live);
  EXPECT_NEAR(ProbabilityAt(std::nullopt), Updated(Relaxed(0.7, 810.0), 2.0), 1e-12);

  RunRecord run{"run", again.run_hash, "truck 1", At(0.0), At(1000.0), {}};
  run.uuid = uuid;
  run.evidence = {TwoStateEvidence(At(820.0), At(880.0), 0.0, 1.0)};
  CommitOptions options;
  options.parent = version_.version;
  options.states_probabilities = false;
  const MapContent next = TwoStateContent(kRate, 0.6, At(1000.0));
  ASSERT_THAT(store_.Commit("a", next, {"", "", 0, {run}}, options), IsOk());
  EXPECT_THAT(MustReturn(old).set_aside, ElementsAre(IsAside(SetAside::kRunInMap, 1)));
  EXPECT_NEAR(ProbabilityAt(At(880.0)), Relaxed(Updated(Relaxed(0.7, 820.0), 1.0), 120.0), 1e-12);
  EXPECT_THAT(store_.Evidence("a", VersionNumber(2))->size(), 1u);
  EXPECT_EQ(store_.RunIdentities("a", VersionNumber(2))->count(uuid), 1u);
  ASSERT_THAT(store_.Exclude("a", {"0f8fad5b", "", {}, "slipped", {}}), IsOk());
  EXPECT_NEAR(ProbabilityAt(At(880.0)), Relaxed(0.7, 1000.0), 1e-12);
}

TEST_F(LedgerTest, MergedModesEvidenceGoesToTheModeThatStandsForThem) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  report.evidence = {TwoStateEvidence(At(2000.0), At(2000.0), 0.0, -9.0)};
  report.evidence[0].modes.push_back({ModeNumber(2), 1.5});
  MapContent next = TwoStateContent(kRate, 0.6, At(2000.0));
  next.groups[0].merged = {{ModeNumber(2), ModeNumber(1)}};
  ASSERT_THAT(store_.Commit("a", next, {}, {version_.version, true}), IsOk());
  report.evidence[0].begin = report.evidence[0].end = At(2500.0);
  EXPECT_THAT(MustReturn(report).set_aside, IsEmpty());
  EXPECT_NEAR(ProbabilityAt(std::nullopt), Updated(Relaxed(0.6, 500.0), 1.5), 1e-12);
  EXPECT_EQ(store_.LoadAt("a")->groups()[0].merged[0].number, ModeNumber(2));
}

TEST_F(LedgerTest, SightingsAreNewestFirst) {
  ShiftReport report = EmptyReport(version_, "a", 1);
  for (int i = 0; i < 3; ++i) {
    UnmappedSighting sighting;
    sighting.signature = Signature(std::string(static_cast<std::size_t>(i), 'x'));
    sighting.p_map_landmark = {1.0 * i, -2.0 * i};
    sighting.cov_p_map_landmark << 0.5, 0.1, 0.1, 0.7;
    sighting.count = 3 + i;
    sighting.first = At(i);
    sighting.last = At(10.0 * i);
    report.sightings.push_back(sighting);
  }
  report.decisions = {{Signature("A"), ModeNumber(1), At(3.0), 18.5}};
  MustReturn(report);
  const StatusOr<std::vector<UnmappedSighting>> sightings = store_.Sightings("a");
  ASSERT_THAT(sightings, IsOk());
  ASSERT_THAT(*sightings, SizeIs(3));
  EXPECT_EQ((*sightings)[0].count, 5);
  EXPECT_EQ((*sightings)[0].signature, Signature("xx"));
  EXPECT_EQ((*sightings)[0].p_map_landmark, Eigen::Vector2d(2.0, -4.0));
  EXPECT_THAT((*sightings)[0].cov_p_map_landmark,
              IsNearMatrix(report.sightings[2].cov_p_map_landmark, 0.0));
  EXPECT_EQ((*sightings)[2].last, At(0.0));
  EXPECT_EQ((*sightings)[1].first, At(1.0));
}

}  // namespace
}  // namespace shiftmap::testing

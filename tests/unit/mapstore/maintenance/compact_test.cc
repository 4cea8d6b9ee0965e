// SPDX-License-Identifier: Apache-2.0
#include "mapstore/maintenance/compact.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/maintenance/verify.h"
#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using ::testing::SizeIs;

// Ten nightly versions, a day apart, and a report against each from the day after it.
class CompactTest : public ::testing::Test {
 protected:
  CompactTest() {
    std::mt19937_64 random(TestSeed(21));
    MapStore store = OpenStore(path_);
    MapContent content = RandomContent(random);
    content.stamp = At(0.0);
    std::optional<VersionNumber> parent;
    for (int i = 0; i < kNights; ++i) {
      content.stamp += std::chrono::hours(24);
      CommitOptions options;
      options.parent = parent;
      const CommitResult version = *store.Commit("mine", content, {}, options);
      parent = version.version;
      ShiftReport report = EmptyReport(version, "mine", i);
      const Stamp begin = content.stamp + std::chrono::hours(6);
      report.evidence = {RandomEvidence(random, content.groups[0], begin, begin)};
      report.decisions = {{content.groups[0].signature, ModeNumber(1), begin, 20.0}};
      report.end = begin;
      EXPECT_THAT(store.Return(report), IsOk());
    }
  }

  static constexpr int kNights = 10;
  TempDir dir_;
  const std::string path_ = dir_.File("a.db");
};

TEST_F(CompactTest, KeepsTheNewestVersionsTheRestStaysExplained) {
  RetentionPolicy policy;
  policy.keep_versions = 3;
  const std::string before = ContentHash(OpenStore(path_).LoadAt("mine")->content());
  EXPECT_EQ(CompactStore(path_, policy, true)->versions, 7);
  EXPECT_THAT(OpenStore(path_).LoadAt("mine", VersionNumber(1)), IsOk());
  const StatusOr<CompactResult> result = CompactStore(path_, policy, false);
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->versions, 7);
  EXPECT_EQ(result->evidence_rows, 0);
  EXPECT_LT(result->bytes_after, result->bytes_before);
  MapStore store = OpenStore(path_);
  const std::vector<VersionSummary> versions = *store.Versions("mine");
  ASSERT_THAT(versions, SizeIs(kNights));
  EXPECT_FALSE(versions[6].content_stored);
  EXPECT_TRUE(versions[7].content_stored);
  EXPECT_THAT(versions[0].content_hash, SizeIs(64));
  EXPECT_EQ(ContentHash(store.LoadAt("mine")->content()), before);
  EXPECT_THAT(store.LoadAt("mine", VersionNumber(1)),
              StatusIs(StatusCode::kNotFound, "only its row"));
  EXPECT_THAT(store.Rollback("mine", VersionNumber(2)),
              StatusIs(StatusCode::kFailedPrecondition, "compacted away"));
  EXPECT_THAT(store.Rollback("mine", VersionNumber(8)), IsOk());
}

TEST_F(CompactTest, EvidenceThatCountsForAKeptVersionStays) {
  RetentionPolicy policy;
  policy.keep_versions = 2;
  policy.evidence_before = At(1e9);
  const std::string before = ContentHash(OpenStore(path_).LoadAt("mine")->content());
  const std::string before_9 =
      ContentHash(OpenStore(path_).LoadAt("mine", VersionNumber(9))->content());
  const StatusOr<CompactResult> result = CompactStore(path_, policy, false);
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->evidence_rows, kNights - 2);
  EXPECT_EQ(result->decisions, kNights);
  MapStore store = OpenStore(path_);
  EXPECT_EQ(ContentHash(store.LoadAt("mine")->content()), before);
  EXPECT_EQ(ContentHash(store.LoadAt("mine", VersionNumber(9))->content()), before_9);
  // Reports stay by UUID: one that comes again changes nothing.
  EXPECT_THAT(*store.Reports("mine"), SizeIs(kNights));
  const VersionSummary first = (*store.Versions("mine"))[0];
  EXPECT_TRUE(store.Return(EmptyReport({first.version, first.content_hash}, "mine", 0))->duplicate);
}

// Three vehicles, each past a landmark twice an hour for sixty days, while it moves to and fro and
// is silent now and then; one of them misreads it once.
class ThinTest : public ::testing::Test {
 protected:
  static constexpr double kDayS = 86'400.0;
  static constexpr double kRate = 1.0 / (6.0 * kDayS);

  ThinTest() {
    std::mt19937_64 random(TestSeed(5));
    MapStore store = OpenStore(path_);
    const CommitResult version = *store.Commit("a", TwoStateContent(kRate, 0.5, At(0.0)), {}, {});
    std::exponential_distribution<double> stay(kRate);
    bool there = true;
    double until = stay(random);
    std::vector<ShiftReport> reports;
    for (int visit = 0; visit < kVisits; ++visit) {
      if (visit % kVisitsPerDay == 0) {
        for (const ShiftReport& report : reports) EXPECT_THAT(store.Return(report), IsOk());
        reports.clear();
        for (int vehicle = 0; vehicle < kVehicles; ++vehicle) {
          reports.push_back(EmptyReport(version, "a", visit + vehicle));
          reports.back().vehicle = "truck " + std::to_string(vehicle);
        }
      }
      const double time = kDayS / kVisitsPerDay * (visit + 1);
      for (; until < time; until += stay(random)) there = !there;
      const bool silent = visit % 7 == 3;
      const bool misread = visit == kVisits / 3;
      const double ratio = silent ? -0.5 : there != misread ? 20.0 : -20.0;
      ShiftReport& report = reports[static_cast<std::size_t>(visit % kVehicles)];
      report.evidence.push_back(TwoStateEvidence(At(time), At(time + 60.0), 0.0, ratio));
      report.end = At(time + 60.0);
    }
    for (const ShiftReport& report : reports) EXPECT_THAT(store.Return(report), IsOk());
  }

  double At1(MapStore* store, double time) {
    return store->LoadAt("a", std::nullopt, At(time))->groups()[0].probabilities(1);
  }

  // The rate that is likeliest for what is seen at the visits that are sure, each as it says.
  static double LikeliestRate(MapStore* store) {
    std::vector<std::pair<double, bool>> gaps;  // Whether the state is the same after it.
    std::optional<std::pair<Stamp, bool>> last;
    const std::vector<EvidenceRow> rows = *store->Evidence("a", VersionNumber(1));
    for (const EvidenceRow& row : rows) {
      const double ratio = row.evidence.modes[1].log_likelihood;
      if (std::abs(ratio) < 10.0) continue;
      const bool there = ratio > 0.0;
      if (last) {
        gaps.emplace_back(ToSeconds(row.evidence.begin - last->first), there == last->second);
      }
      last = {row.evidence.end, there};
    }
    double best = 0.0;
    double largest = -1e300;
    for (double rate = 0.1 * kRate; rate < 10.0 * kRate; rate *= 1.002) {
      double sum = 0.0;
      for (const auto& [gap, same] : gaps) {
        const double stayed = std::exp(-2.0 * rate * gap);
        sum += std::log(0.5 * (same ? 1.0 + stayed : 1.0 - stayed));
      }
      if (sum > largest) best = rate;
      largest = std::max(largest, sum);
    }
    return best;
  }

  static constexpr int kVehicles = 3;
  static constexpr int kVisitsPerDay = 144;
  static constexpr int kVisits = 60 * kVisitsPerDay;
  TempDir dir_;
  const std::string path_ = dir_.File("a.db");
};

// The oracle is the store before.
TEST_F(ThinTest, WhatIsKnownAndLearnedStays) {
  const std::string thinned = dir_.File("b.db");
  std::filesystem::copy_file(path_, thinned);
  RetentionPolicy policy;
  policy.thin_before = At(50.0 * kDayS);
  EXPECT_GT(CompactStore(thinned, policy, true)->thinned_rows, 0);
  const StatusOr<CompactResult> result = CompactStore(thinned, policy, false);
  ASSERT_THAT(result, IsOk());
  const int old = kVisits * 50 / 60;
  EXPECT_GT(result->thinned_rows, old * 9 / 10);
  EXPECT_LT(result->bytes_after, result->bytes_before);
  EXPECT_EQ(CompactStore(thinned, policy, false)->thinned_rows, 0);
  EXPECT_TRUE(VerifyStore(thinned)->clean());
  // Sixty days at ten stays of six days: a few rows for each stay are left.
  EXPECT_LT(old - result->thinned_rows, old / 20);

  MapStore before = OpenStore(path_);
  MapStore after = OpenStore(thinned);
  EXPECT_GT(before.Evidence("a", VersionNumber(1))->size(), 8'000u);
  for (double day = 0.02; day < 60.0; day += 0.173) {
    EXPECT_NEAR(At1(&after, day * kDayS), At1(&before, day * kDayS), day < 50.0 ? 0.1 : 1e-6)
        << day;
  }
  EXPECT_NEAR(LikeliestRate(&after) / LikeliestRate(&before), 1.0, 0.01);
}

// What is summed up is summed up again with what came since, as if all had come at once.
TEST_F(ThinTest, SummariesAreSummedUp) {
  RetentionPolicy policy;
  for (double day = 5.0; day < 55.0; day += 5.0) {
    policy.thin_before = At(day * kDayS);
    ASSERT_THAT(CompactStore(path_, policy, false), IsOk());
  }
  EXPECT_TRUE(VerifyStore(path_)->clean());
  MapStore store = OpenStore(path_);
  Eigen::Index rows = 0;
  const std::vector<EvidenceRow> evidence = *store.Evidence("a", VersionNumber(1));
  for (const EvidenceRow& row : evidence) {
    EXPECT_LE(row.evidence.begin, row.evidence.end);
    rows += row.evidence.begin < *policy.thin_before ? 1 : 0;
  }
  // No more than two hundred steps for each stay of the usual length.
  EXPECT_LT(rows, 2600);
  std::int64_t counted = 0;
  const std::vector<ReportSummary> reports = *store.Reports("a");
  for (const ReportSummary& report : reports) counted += report.evidence_rows;
  EXPECT_LT(counted, 1700);
  EXPECT_NEAR(LikeliestRate(&store) / kRate, 1.0, 0.8);
}

// Two vehicles pass at about the same times, now the one and now the other first: a summary has
// rows of both, and no report is given one from before its first visit.
TEST_F(CompactTest, SummariesOfParallelShiftsAreSound) {
  std::mt19937_64 random(TestSeed(9));
  std::uniform_real_distribution<double> later(0.0, 3000.0);
  for (int trial = 0; trial < 20; ++trial) {
    const std::string path = dir_.File(std::to_string(trial) + ".db");
    MapStore store = OpenStore(path);
    const CommitResult version = *store.Commit("a", TwoStateContent(1e-9, 0.5, At(0.0)), {}, {});
    for (int shift = 0; shift < 6; ++shift) {
      for (int vehicle = 0; vehicle < 3; ++vehicle) {
        ShiftReport report = EmptyReport(version, "a", 3 * shift + vehicle);
        report.vehicle = "truck " + std::to_string(vehicle);
        const Stamp begin = At(1e4 * shift + later(random));
        report.evidence.push_back(TwoStateEvidence(begin, begin, 0.0, 20.0));
        report.end = begin;
        ASSERT_THAT(store.Return(report), IsOk());
      }
    }
    RetentionPolicy policy;
    policy.thin_before = At(1e6);
    ASSERT_GT(CompactStore(path, policy, false)->thinned_rows, 0);
    EXPECT_TRUE(VerifyStore(path)->clean()) << trial;
  }
}

// What is neither here nor there by itself adds up.
TEST_F(CompactTest, ALongSilenceStays) {
  const std::string path = dir_.File("b.db");
  MapStore store = OpenStore(path);
  const CommitResult version = *store.Commit("a", TwoStateContent(1e-5, 0.5, At(0.0)), {}, {});
  for (int vehicle = 0; vehicle < 2; ++vehicle) {
    ShiftReport report = EmptyReport(version, "a", vehicle);
    report.vehicle = "truck " + std::to_string(vehicle);
    for (int visit = vehicle; visit < 40; visit += 2) {
      const bool silent = visit >= 10 && visit < 30;
      const Stamp begin = At(10.0 * visit);
      report.evidence.push_back(TwoStateEvidence(begin, begin, 0.0, silent ? -0.9 : 20.0));
      report.end = begin;
    }
    ASSERT_THAT(store.Return(report), IsOk());
  }
  RetentionPolicy policy;
  policy.thin_before = At(1e6);
  // Of the first ten visits two at either end stay, and one for the others; so of the last ten.
  // What is learned from has a visit at either end of that one.
  EXPECT_EQ(CompactStore(path, policy, false)->thinned_rows, 2 * (10 - 5));
  EXPECT_EQ(store.Evidence("a", version.version)->size(), 20u + 2u * (4u + 2u));
}

TEST_F(CompactTest, AHeldRunIsNotSpent) {
  MapStore store = OpenStore(path_);
  const std::string before = ContentHash(store.LoadAt("mine")->content());
  const std::string report = (*store.Reports("mine"))[0].uuid;
  ASSERT_THAT(store.Exclude("mine", {report, "", {}, "to be looked at", true}), IsOk());
  RetentionPolicy policy;
  policy.evidence_before = At(1e9);
  ASSERT_THAT(CompactStore(path_, policy, false), IsOk());
  ASSERT_THAT(store.IncludeAll("mine", {{report, "", {}, "", {}}}), IsOk());
  EXPECT_EQ(ContentHash(store.LoadAt("mine")->content()), before);
}

TEST_F(CompactTest, ASnapshotHasNoPastToThinOrToAskFor) {
  const std::string path = dir_.File("snapshot.db");
  ASSERT_THAT(OpenStore(path_).ExportSnapshot("mine", path), IsOk());
  RetentionPolicy policy;
  policy.thin_before = At(1e9);
  EXPECT_THAT(CompactStore(path, policy, false),
              StatusIs(StatusCode::kFailedPrecondition, "is a snapshot"));
  MapStore snapshot = *MapStore::Open(path, MapStore::Access::kReadOnly);
  EXPECT_THAT(snapshot.LoadKnown("mine", At(1e9)),
              StatusIs(StatusCode::kFailedPrecondition, "a snapshot does not hold"));
}

TEST_F(CompactTest, MustKeepAVersion) {
  RetentionPolicy policy;
  policy.keep_versions = 0;
  EXPECT_THAT(CompactStore(path_, policy, false),
              StatusIs(StatusCode::kInvalidArgument, "at least 1"));
}

}  // namespace
}  // namespace shiftmap::testing

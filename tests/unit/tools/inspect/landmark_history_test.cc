// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/landmark_history.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "mapstore/maintenance/compact.h"
#include "mapstore/map_store.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/tools/inspect/landmark_test_util.h"
#include "tools/inspect/landmark_text.h"

namespace shiftmap {
namespace {

using testing::ContentOf;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::IsOk;
using ::testing::SizeIs;
using testing::StatusIs;

Stamp At(double seconds) { return StampFromSeconds(1.7e9 + seconds); }

Mode ModeAt(std::int64_t number, double x_m, double sd_m = 0.1) {
  Mode mode;
  mode.number = ModeNumber(number);
  mode.p_map_landmark = {x_m, 0.0};
  mode.cov_p_map_landmark = sd_m * sd_m * Eigen::Matrix2d::Identity();
  return mode;
}

LandmarkGroup Group(const std::string& signature, std::vector<Mode> modes) {
  LandmarkGroup group;
  group.signature = Signature(signature);
  group.modes = std::move(modes);
  const int count = static_cast<int>(group.modes.size());
  group.chain = ModeChain::Uniform(count, 1e-4);
  group.probabilities = Eigen::VectorXd::Constant(count + 1, 1.0 / (count + 1));
  return group;
}

VisitEvidence Visit(const std::string& signature, double begin_s, std::vector<double> values) {
  VisitEvidence visit;
  visit.signature = Signature(signature);
  visit.begin = At(begin_s);
  visit.end = At(begin_s + 20.0);
  visit.observations = 5;
  for (std::size_t i = 0; i < values.size(); ++i) {
    visit.modes.push_back({ModeNumber(static_cast<std::int64_t>(i)), values[i]});
  }
  return visit;
}

RunRecord MappedRun(int number, std::vector<VisitEvidence> evidence) {
  RunRecord run;
  run.name = fmt::format("run_{:03}", number);
  run.sha256 = fmt::format("{:064x}", number);
  run.vehicle = number % 2 == 0 ? "even" : "odd";
  run.begin = At(1000.0 * number);
  run.end = At(1000.0 * number + 900.0);
  run.evidence = std::move(evidence);
  return run;
}

// Version 1 maps run 0 with one mode of 'A'; version 2 adds run 1 and mode 2, and moves mode 1;
// two shifts are reported against version 2, the second of them also about 'B'.
class LandmarkHistoryTest : public ::testing::Test {
 protected:
  LandmarkHistoryTest() {
    CommitOptions options;
    options.states_probabilities = false;
    first_ = *store_.Commit("a",
                            ContentOf({Group("A", {ModeAt(1, 0.0)})}, At(900.0)),
                            {"test", "", 0, {MappedRun(0, {Visit("A", 100.0, {0.0, 4.0})})}},
                            options);
    options.parent = first_.version;
    second_ = *store_.Commit(
        "a",
        ContentOf({Group("A", {ModeAt(1, 1.0), ModeAt(2, 5.0)}), Group("B", {ModeAt(1, 9.0)})},
                  At(1900.0)),
        {"test", "", 0, {MappedRun(1, {Visit("A", 1100.0, {0.0, -3.0, 3.0})})}},
        options);
    Return(2, {Visit("A", 2100.0, {0.0, 5.0, -2.0})}, 1.0);
    Return(3, {Visit("A", 3100.0, {0.0, -2.0, 6.0}), Visit("B", 3200.0, {0.0, 1.0})}, 6.0);
  }

  void Return(int number, std::vector<VisitEvidence> evidence, double log_odds) {
    ShiftReport report;
    report.uuid = fmt::format("00000000-0000-4000-8000-{:012}", number);
    report.vehicle = number % 2 == 0 ? "even" : "odd";
    report.area = "a";
    report.version = second_.version;
    report.content_hash = second_.content_hash;
    report.software = "test";
    report.begin = At(1000.0 * number);
    report.end = At(1000.0 * number + 900.0);
    report.decisions = {{Signature("A"), ModeNumber(1), evidence[0].begin, 0.5},
                        {Signature("A"), ModeNumber(2), evidence[0].end, log_odds}};
    report.evidence = std::move(evidence);
    ASSERT_THAT(store_.Return(report), IsOk());
  }

  LandmarkHistory Load(const std::string& signature, const HistoryOptions& options = {}) {
    StatusOr<LandmarkHistory> history =
        LoadLandmarkHistory(&store_, "a", Signature(signature), options);
    EXPECT_THAT(history, IsOk());
    return *std::move(history);
  }

  std::vector<double> ProbabilitiesAt(Stamp at) {
    const MapSnapshot map = *store_.LoadAt("a", std::nullopt, at);
    const Eigen::VectorXd& p = map.groups()[0].probabilities;
    return {p.begin(), p.end()};
  }

  static std::vector<double> Values(const std::vector<ModeProbability>& modes) {
    std::vector<double> values;
    for (const ModeProbability& mode : modes) values.push_back(mode.probability);
    return values;
  }

  testing::TempDir dir_;
  MapStore store_ = *MapStore::Open(dir_.File("a.db"), MapStore::Access::kReadWriteCreate);
  CommitResult first_;
  CommitResult second_;
};

TEST_F(LandmarkHistoryTest, EveryVisitIsARowWithWhatItSaysAndWhereItComesFrom) {
  const LandmarkHistory history = Load("A");
  ASSERT_THAT(history.visits, SizeIs(4));
  const HistoryVisit& mapped = history.visits[1];
  EXPECT_TRUE(mapped.mapped);
  EXPECT_EQ(mapped.run_name, "run_001");
  EXPECT_EQ(mapped.vehicle, "odd");
  EXPECT_EQ(mapped.version, second_.version);
  EXPECT_EQ(mapped.begin, At(1100.0));
  EXPECT_EQ(mapped.observations, 5);
  EXPECT_EQ(mapped.likely_mode, ModeNumber(2));
  EXPECT_DOUBLE_EQ(mapped.log_odds, 3.0);
  EXPECT_EQ(mapped.known_since, second_.version);
  EXPECT_FALSE(mapped.decision);
  const HistoryVisit& reported = history.visits[3];
  EXPECT_FALSE(reported.mapped);
  EXPECT_EQ(reported.report, "00000000-0000-4000-8000-000000000003");
  ASSERT_TRUE(reported.decision);
  EXPECT_EQ(reported.decision->mode, ModeNumber(2));
  EXPECT_EQ(reported.decision->stamp, reported.end);
  EXPECT_DOUBLE_EQ(reported.decision->log_odds, 6.0);
  EXPECT_THAT(history.mapped_by, ElementsAre(first_.version, second_.version));
}

TEST_F(LandmarkHistoryTest, ProbabilitiesAfterEachVisitAreThoseOfTheMapThen) {
  const LandmarkHistory history = Load("A");
  for (std::size_t i = 2; i < history.visits.size(); ++i) {
    EXPECT_EQ(Values(history.visits[i].probabilities), ProbabilitiesAt(history.visits[i].end));
  }
  EXPECT_EQ(Values(history.probabilities), ProbabilitiesAt(history.stamp));
  EXPECT_EQ(history.stamp, store_.LoadAt("a")->stamp());
}

TEST_F(LandmarkHistoryTest, TheTrackIsTheMapAtEachTime) {
  HistoryOptions options;
  options.track = {At(5000.0), At(2050.0), At(2105.0), At(3500.0)};
  const LandmarkHistory history = Load("A", options);
  ASSERT_THAT(history.track, SizeIs(4));
  for (const ModeProbabilities& at : history.track) {
    EXPECT_EQ(Values(at.modes), ProbabilitiesAt(at.stamp));
  }
}

TEST_F(LandmarkHistoryTest, ModesKnowTheirVersionsVisitsAndMoves) {
  const LandmarkHistory history = Load("A");
  ASSERT_THAT(history.modes, SizeIs(2));
  const ModeHistory& one = history.modes[0];
  EXPECT_EQ(one.first_version, first_.version);
  EXPECT_EQ(one.visits, 2);
  EXPECT_EQ(one.first_visit, 0U);
  EXPECT_EQ(one.last_visit, 2U);
  ASSERT_THAT(one.positions, SizeIs(2));
  EXPECT_EQ(one.positions[1].version, second_.version);
  EXPECT_EQ(one.positions[1].p_map_landmark.x(), 1.0);
  const ModeHistory& two = history.modes[1];
  EXPECT_EQ(two.first_version, second_.version);
  EXPECT_THAT(two.positions, SizeIs(1));
  EXPECT_FALSE(two.gone);
}

// The version that had a mode first may be compacted away: then the oldest that is left is a bound.
TEST_F(LandmarkHistoryTest, AModeSaysThatItMayBeOlderThanTheVersionsThatAreLeft) {
  const LandmarkHistory before = Load("A");
  ASSERT_THAT(before.modes, SizeIs(2));
  EXPECT_FALSE(before.modes[0].or_before);
  EXPECT_FALSE(before.modes[1].or_before);
  RetentionPolicy policy;
  policy.keep_versions = 1;
  ASSERT_THAT(CompactStore(dir_.File("a.db"), policy, false), IsOk());
  const LandmarkHistory after = Load("A");
  ASSERT_THAT(after.modes, SizeIs(2));
  for (const ModeHistory& mode : after.modes) {
    EXPECT_EQ(mode.first_version, second_.version);
    EXPECT_TRUE(mode.or_before);
  }
  const auto since = [](const LandmarkHistory& history) {
    return std::any_of(history.visits.begin(), history.visits.end(), [](const HistoryVisit& visit) {
      return visit.known_since && visit.or_before;
    });
  };
  EXPECT_FALSE(since(before));
  EXPECT_TRUE(since(after));
  const Json json = HistoryJson(after, 0);
  EXPECT_EQ(json["modes"][0]["first_version_or_before"], true);
  EXPECT_THAT(ModesText(after, {}), ::testing::HasSubstr("<=2"));
}

TEST_F(LandmarkHistoryTest, AMergedModeNamesTheOneThatStandsForIt) {
  LandmarkGroup merged = Group("A", {ModeAt(1, 1.0)});
  merged.merged = {{ModeNumber(2), ModeNumber(1)}};
  CommitOptions options;
  options.parent = second_.version;
  options.states_probabilities = false;
  ASSERT_THAT(store_.Commit("a", ContentOf({merged}, At(4000.0)), {}, options), IsOk());
  const LandmarkHistory history = Load("A");
  ASSERT_THAT(history.modes, SizeIs(2));
  EXPECT_TRUE(history.modes[1].gone);
  EXPECT_EQ(history.modes[1].merged_into, ModeNumber(1));
  EXPECT_EQ(history.visits[3].likely_mode, ModeNumber(2));
  EXPECT_EQ(history.visits[3].current_mode, ModeNumber(1));
  EXPECT_EQ(history.visits[3].known_since, first_.version);
}

TEST_F(LandmarkHistoryTest, ReasonsWhyRowsDoNotCountAreThoseOfTheReports) {
  ASSERT_THAT(store_.Rollback("a"), IsOk());
  LandmarkHistory history = Load("A");
  EXPECT_EQ(history.visits[0].set_aside, std::nullopt);
  EXPECT_EQ(history.visits[1].set_aside, SetAside::kLaterVersion);
  EXPECT_EQ(history.visits[2].set_aside, std::nullopt);
  EXPECT_EQ(history.visits[3].set_aside, SetAside::kNoMode);
  EXPECT_THAT(history.visits[3].probabilities, IsEmpty());
  ASSERT_THAT(store_.Exclude("a", {std::string(63, '0') + "0", "", {}, "slipped", false}), IsOk());
  EXPECT_EQ(Load("A").visits[0].set_aside, SetAside::kExcluded);
  ASSERT_THAT(store_.Exclude("a", {"", "even", At(1500.0), "odd", true}), IsOk());
  EXPECT_EQ(Load("A").visits[2].set_aside, SetAside::kHeld);

  const LandmarkHistory other = Load("B");
  EXPECT_FALSE(other.in_version);
  EXPECT_EQ(other.visits[0].set_aside, SetAside::kNoLandmark);
  std::map<SetAside, int> rows;
  for (const LandmarkHistory& landmark : {Load("A"), other}) {
    for (const HistoryVisit& visit : landmark.visits) {
      if (!visit.mapped && visit.set_aside) ++rows[*visit.set_aside];
    }
  }
  std::map<SetAside, int> reported;
  const std::vector<ReportSummary> reports = *store_.Reports("a");
  for (const ReportSummary& report : reports) {
    for (const SetAsideRows& aside : report.set_aside) reported[aside.reason] += aside.rows;
  }
  EXPECT_EQ(rows, reported);
}

TEST_F(LandmarkHistoryTest, ATimeLeavesLaterVisitsOutAndAnEarlierKnowledgeMarksThem) {
  EXPECT_THAT(Load("A", {.at = At(2500.0)}).visits, SizeIs(3));
  const Stamp before = store_.Versions("a")->back().created;
  const LandmarkHistory known = Load("A", {.version = second_.version, .known = before});
  EXPECT_EQ(known.visits[2].set_aside, SetAside::kUnknown);
  const MapSnapshot map = *store_.LoadKnown("a", before, second_.version);
  const Eigen::VectorXd& expected = map.groups()[0].probabilities;
  EXPECT_EQ(Values(known.probabilities), std::vector<double>(expected.begin(), expected.end()));
}

TEST_F(LandmarkHistoryTest, ASnapshotTellsWhatItHolds) {
  ASSERT_THAT(store_.ExportSnapshot("a", dir_.File("snapshot.db")), IsOk());
  const LandmarkHistory whole = Load("A");
  store_ = *MapStore::Open(dir_.File("snapshot.db"), MapStore::Access::kReadOnly);
  const LandmarkHistory snapshot = Load("A", {.track = {whole.stamp}});
  EXPECT_EQ(Values(snapshot.probabilities), Values(whole.probabilities));
  EXPECT_EQ(Values(snapshot.track[0].modes), Values(whole.probabilities));
  EXPECT_EQ(snapshot.version, whole.version);
  EXPECT_THAT(LoadLandmarkHistory(&store_, "a", Signature("A"), {.known = At(0.0)}),
              StatusIs(StatusCode::kFailedPrecondition, "snapshot"));
}

// A rename is a name: visits, versions and probabilities are those of before.
TEST_F(LandmarkHistoryTest, ARenamedLandmarkKeepsItsHistory) {
  const LandmarkHistory before = Load("A");
  MapEdit rename;
  rename.kind = EditKind::kRename;
  rename.signature = Signature("A");
  rename.new_name = Signature("Z");
  rename.author = "anna";
  rename.reason = "a new tag";
  ASSERT_THAT(store_.Edit("a", rename), IsOk());
  const LandmarkHistory after = Load("Z");
  ASSERT_THAT(after.visits, SizeIs(before.visits.size()));
  for (std::size_t i = 0; i < before.visits.size(); ++i) {
    EXPECT_EQ(after.visits[i].begin, before.visits[i].begin);
    EXPECT_EQ(after.visits[i].set_aside, before.visits[i].set_aside);
    EXPECT_EQ(after.visits[i].decision.has_value(), before.visits[i].decision.has_value());
    ASSERT_EQ(after.visits[i].probabilities.size(), before.visits[i].probabilities.size());
    for (std::size_t k = 0; k < before.visits[i].probabilities.size(); ++k) {
      EXPECT_EQ(after.visits[i].probabilities[k].probability,
                before.visits[i].probabilities[k].probability);
    }
  }
  ASSERT_THAT(after.modes, SizeIs(2));
  EXPECT_EQ(after.modes[0].first_version, first_.version);
  EXPECT_EQ(Load("A").signature, Signature("Z"));
  EXPECT_THAT(Load("A").visits, SizeIs(before.visits.size()));
}

TEST_F(LandmarkHistoryTest, ALandmarkThatNobodyKnowsIsNotFound) {
  EXPECT_THAT(LoadLandmarkHistory(&store_, "a", Signature("C")),
              StatusIs(StatusCode::kNotFound, "area 'a': no landmark 'C'"));
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
//
// The commands that tell of single landmarks, and of what changed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "mapstore/map_store.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/tools/inspect/landmark_test_util.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/landmark_text.h"

namespace shiftmap {
namespace {

using testing::ContentOf;
using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::Not;

Stamp At(double seconds) { return StampFromSeconds(1.7e9 + seconds); }

Mode ModeAt(std::int64_t number, double x_m) {
  Mode mode;
  mode.number = ModeNumber(number);
  mode.p_map_landmark = {x_m, 0.0};
  mode.cov_p_map_landmark = 0.01 * Eigen::Matrix2d::Identity();
  return mode;
}

LandmarkGroup Group(const std::string& signature, std::vector<Mode> modes, double rate_per_s) {
  LandmarkGroup group;
  group.signature = Signature(signature);
  group.modes = std::move(modes);
  const int count = static_cast<int>(group.modes.size());
  group.chain = ModeChain::Uniform(count, rate_per_s);
  group.probabilities = Eigen::VectorXd::Zero(count + 1);
  group.probabilities(1) = 1.0;
  return group;
}

// From version 1 to 2: 'L01' shifts within its covariance, 'L02' moves, 'L03' is gone, 'L04' is
// new, and 'L05' gets a rate that is far outside of any interval.
class LandmarkCommands : public ::testing::Test {
 protected:
  LandmarkCommands() {
    MapStore store = *MapStore::Open(store_, MapStore::Access::kReadWriteCreate);
    const CommitResult first = *store.Commit("hall",
                                             ContentOf({Group("L01", {ModeAt(1, 0.0)}, 1e-5),
                                                        Group("L02", {ModeAt(1, 10.0)}, 1e-2),
                                                        Group("L03", {ModeAt(1, 20.0)}, 1e-5),
                                                        Group("L05", {ModeAt(1, 30.0)}, 1e-9)},
                                                       At(0.0)),
                                             {},
                                             {});
    CommitOptions options;
    options.parent = first.version;
    const CommitResult second = *store.Commit("hall",
                                              ContentOf({Group("L01", {ModeAt(1, 0.05)}, 1e-5),
                                                         Group("L02", {ModeAt(1, 12.0)}, 1e-2),
                                                         Group("L04", {ModeAt(1, 40.0)}, 1e-5),
                                                         Group("L05", {ModeAt(1, 30.0)}, 1e-3)},
                                                        At(0.0)),
                                              {},
                                              options);
    ShiftReport report;
    report.uuid = "00000000-0000-4000-8000-000000000001";
    report.vehicle = "truck\x1b[2J";
    report.area = "hall";
    report.version = second.version;
    report.content_hash = second.content_hash;
    report.software = "test";
    report.begin = At(10.0);
    report.end = At(90.0);
    VisitEvidence visit;
    visit.signature = Signature("L02");
    visit.begin = At(20.0);
    visit.end = At(30.0);
    visit.modes = {{kAbsent, 4.0}, {ModeNumber(1), 0.0}};
    report.evidence = {visit};
    visit.begin = At(40.0);
    visit.end = At(50.0);
    visit.observations = 3;
    report.evidence.push_back(visit);
    UnmappedSighting sighting;
    sighting.signature = Signature("L02");
    sighting.p_map_landmark = {55.0, 5.0};
    sighting.cov_p_map_landmark = 0.01 * Eigen::Matrix2d::Identity();
    sighting.count = 3;
    sighting.first = At(40.0);
    sighting.last = At(50.0);
    report.sightings = {sighting};
    EXPECT_THAT(store.Return(report), IsOk());
  }

  std::string Run(std::vector<std::string> arguments, int code = 0) {
    arguments.insert(arguments.end(), {"--store", store_, "--area", "hall"});
    Application application("shiftmap-inspect", "");
    AddInspectCommands(&application);
    std::ostringstream out;
    std::ostringstream err;
    EXPECT_EQ(static_cast<int>(application.Run(arguments, &out, &err)), code) << err.str();
    return code == 0 ? out.str() : err.str();
  }

  testing::TempDir dir_;
  std::string store_ = dir_.File("maps.db");
};

TEST_F(LandmarkCommands, HistoryAnswersWhyALandmarkIsAbsent) {
  const std::string text = Run({"history", "L02", "--at", "1700000100"});
  EXPECT_THAT(text, HasSubstr("L02 in area hall, version 2, at 2023-11-14 22:15:00 UTC: absent"));
  EXPECT_THAT(Run({"history", "L02", "--at", "4000000000"}), HasSubstr("UTC: undecided, no state"));
  EXPECT_THAT(text, HasSubstr("seen in 3 scans, says elsewhere 55:1"));
  EXPECT_THAT(text, HasSubstr("seen where it has no mode: at (55.00, 5.00) m, 3 times"));
  EXPECT_THAT(text, HasSubstr("moved 2.00 m in version 2"));
  EXPECT_THAT(text, HasSubstr("version 2 states its probabilities"));
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
  EXPECT_THAT(Run({"history", "L02", "--limit", "1"}), HasSubstr("not shown: 1 older visit;"));
}

TEST_F(LandmarkCommands, HistoryAsADocumentHasEveryVisit) {
  const Json history = Json::parse(Run({"history", "L02", "--json"}));
  ASSERT_EQ(history["visits"].size(), 2U);
  const Json& visit = history["visits"][1];
  EXPECT_EQ(visit["source"], "shift");
  EXPECT_EQ(visit["log_likelihoods"]["0"], 4.0);
  EXPECT_EQ(visit["set_aside"], nullptr);
  EXPECT_GT(visit["probabilities"]["0"], 0.5);
  EXPECT_EQ(history["modes"][0]["positions"].size(), 2U);
  EXPECT_EQ(history["history"].size(), 11U);
  EXPECT_EQ(Json::parse(Run({"history", "L02", "--json", "--steps", "3"}))["history"].size(), 4U);
}

TEST_F(LandmarkCommands, ModesOfOneLandmarkHaveItsRateAndItsLastVisits) {
  const std::string text = Run({"modes", "L02"});
  EXPECT_THAT(text, HasSubstr("moves 864 times a day in the long run (95 % interval"));
  EXPECT_THAT(text, HasSubstr("from 2 visits"));
  const Json modes = Json::parse(Run({"modes", "L02", "--json"}));
  EXPECT_EQ(modes["modes"][0]["x_m"], 12.0);
  EXPECT_EQ(modes["landmark"]["visits"].size(), 2U);
}

TEST(VisitsText, AVisitThatTellsTwoModesNotApartSaysWhichOneItSpeaksAgainst) {
  LandmarkHistory history;
  history.probabilities = {{kAbsent, 0.2}, {ModeNumber(1), 0.3}, {ModeNumber(2), 0.5}};
  HistoryVisit visit;
  visit.log_likelihoods = {{kAbsent, 0.0}, {ModeNumber(1), -3.0}, {ModeNumber(2), 0.0}};
  visit.likely_mode = ModeNumber(2);
  history.visits = {visit};
  EXPECT_THAT(VisitsText(history, 0, {}), HasSubstr("not mode 1 20:1"));
  history.visits[0].log_likelihoods[1].log_likelihood = 0.0;
  EXPECT_THAT(VisitsText(history, 0, {}), HasSubstr("nothing"));
}

TEST_F(LandmarkCommands, AMistypedSignatureIsAnsweredWithTheNearest) {
  EXPECT_THAT(Run({"history", "l02"}, 6), HasSubstr("no landmark 'l02'; did you mean 'L02'?"));
  EXPECT_THAT(Run({"modes", "L03"}, 6), HasSubstr("no landmark 'L03'; only versions 1"));
  for (const char* picture : {"modes", "history"}) {
    EXPECT_THAT(Run({"plot", picture, "l02", "--output", dir_.File("a.svg")}, 6),
                HasSubstr("no landmark 'l02'; did you mean 'L02'?"));
  }
}

TEST_F(LandmarkCommands, DiffPutsWhatMattersFirstAndSumsUpTheRest) {
  const std::string text = Run({"diff", "1", "2"});
  std::vector<std::size_t> places;
  for (const char* change : {"landmark gone", "new landmark", "moved", "move rate"}) {
    places.push_back(text.find(change));
    EXPECT_NE(places.back(), std::string::npos) << change;
  }
  EXPECT_TRUE(std::is_sorted(places.begin(), places.end())) << text;
  EXPECT_THAT(text, HasSubstr("2.000 m by (2.000, 0.000) m, 14.1 standard deviations"));
  EXPECT_THAT(text, HasSubstr("1 mode shifted within their covariance, by 0.050 m on average"));
  EXPECT_THAT(text, Not(HasSubstr("L01")));
  EXPECT_THAT(Run({"diff", "1", "2", "--all"}), HasSubstr("shifted"));
  EXPECT_THAT(Run({"diff", "1", "1"}), HasSubstr("no difference"));
}

// Two states that are equally probable but for rounding: no text takes one for the state.
TEST(UndecidedLandmark, HoldsNoState) {
  const testing::TempDir dir;
  const std::string path = dir.File("maps.db");
  MapStore store = *MapStore::Open(path, MapStore::Access::kReadWriteCreate);
  LandmarkGroup group = Group("L01", {ModeAt(1, 0.0), ModeAt(2, 9.0)}, 1e-5);
  CommitOptions options;
  for (const double p : {0.0, 0.5 + 1e-7, 0.6, 0.5 - 1e-7}) {
    group.probabilities << p, 1.0 - p, 0.0;
    options.parent = store.Commit("hall", ContentOf({group}, At(0.0)), {}, options)->version;
  }
  const auto run = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--store", path, "--area", "hall"});
    Application application("shiftmap-inspect", "");
    AddInspectCommands(&application);
    std::ostringstream out;
    std::ostringstream err;
    EXPECT_EQ(static_cast<int>(application.Run(arguments, &out, &err)), 0) << err.str();
    return out.str();
  };
  const auto show = [&](const char* version) {
    return run({"show", "--version", version, "--at", "1700000000"});
  };
  EXPECT_THAT(show("1"), HasSubstr("1.0000  *"));
  EXPECT_THAT(show("2"), Not(HasSubstr("*")));
  EXPECT_THAT(show("3"), HasSubstr("0.6000  *"));
  EXPECT_THAT(run({"history", "L01", "--version", "2", "--at", "1700000000"}),
              HasSubstr("undecided, no state is more probable than 0.5000"));
  EXPECT_THAT(run({"diff", "1", "2"}), HasSubstr("-  undecided  P 0.500, was mode 1 with P 1.000"));
  EXPECT_THAT(run({"diff", "4", "3"}),
              HasSubstr("0  holds now  P 0.600, was undecided with P 0.500"));
  for (const char* same : {"2", "4"}) {
    EXPECT_THAT(run({"diff", "2", same}), Not(HasSubstr("undecided"))) << "by rounding";
  }
  EXPECT_THAT(run({"diff", "1", "3"}), HasSubstr("0  holds now  P 0.600, was mode 1 with P 1.000"));
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
//
// Edits of a surveyor between the nights: what builds, localizers and snapshots make of them, and
// what is left when they are taken back.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/map/edited_map.h"
#include "mapstore/map_store.h"
#include "mapstore/sqlite/database.h"
#include "tests/scenario/command.h"
#include "tests/scenario/well_formed.h"
#include "tests/scenario/world.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

constexpr int kAttention = 8;

struct Place {
  double x_m = 0.0;
  double y_m = 0.0;
};

double Distance(const Place& a, const Place& b) { return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m); }

class EditScenarioTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new World({"--seed",
                        "5",
                        "--shifts",
                        "4",
                        "--duration-s",
                        "120",
                        "--groups",
                        "14",
                        "--size-m",
                        "22",
                        "--mode-change-probability",
                        "0.1"});
    RunForJson("shiftmap-mapper", world_->BuildOf("first.db", {0}));
  }
  static void TearDownTestSuite() { delete world_; }

  // Two stores with the same first map: one is edited.
  EditScenarioTest() {
    for (const char* store : {kEdited, kPlain}) {
      std::filesystem::copy_file(world_->File("first.db"),
                                 world_->File(store),
                                 std::filesystem::copy_options::overwrite_existing);
    }
  }

  static Arguments EditOf(const Arguments& words) {
    Arguments arguments = {"edit"};
    arguments.insert(arguments.end(), words.begin(), words.end());
    const Arguments rest = {
        "--store", world_->File(kEdited), "--area", "floor", "--author", "ann", "--reason", "test"};
    arguments.insert(arguments.end(), rest.begin(), rest.end());
    return arguments;
  }

  static Json Edit(const Arguments& words) { return RunForJson("shiftmap-inspect", EditOf(words)); }

  static Json Build(const std::string& store, const std::vector<int>& runs) {
    return RunForJson("shiftmap-mapper", world_->BuildOf(store, runs));
  }

  static Json Groups(const std::string& store) {
    return RunForJson("shiftmap-inspect",
                      {"show",
                       "--store",
                       world_->File(store),
                       "--area",
                       "floor",
                       "--at",
                       "1769000000"})["groups"];
  }

  static Json Group(const std::string& store, const std::string& signature) {
    const Json groups = Groups(store);
    for (const Json& group : groups) {
      if (group["signature"] == signature) return group;
    }
    return nullptr;
  }

  // Where the first mode of every landmark is.
  static std::map<std::string, Place> Places(const std::string& store) {
    std::map<std::string, Place> places;
    const Json groups = Groups(store);
    for (const Json& group : groups) {
      for (const Json& mode : group["modes"]) {
        if (mode["mode"] != 1) continue;
        places[group["signature"].get<std::string>()] = {mode["x_m"].get<double>(),
                                                         mode["y_m"].get<double>()};
      }
    }
    return places;
  }

  // Where the landmarks truly stood in the first run.
  static std::map<std::string, Place> TruePlaces() {
    std::map<std::pair<std::string, int>, Place> all;
    for (const std::vector<std::string>& row : ReadCsv(world_->Places())) {
      all[{row[0], std::stoi(row[1])}] = {std::stod(row[2]), std::stod(row[3])};
    }
    std::map<std::string, Place> places;
    for (const World::TrueMode& mode : world_->Modes(0)) {
      if (mode.mode > 0) places[mode.signature] = all[{mode.signature, mode.mode}];
    }
    return places;
  }

  // Commits a version in which one landmark has a second mode 3 cm beside its first, as a night
  // makes one that takes it for displaced. Returns the landmark with the smallest covariance.
  static std::string CommitDuplicate() {
    MapStore store = *MapStore::Open(world_->File(kEdited), MapStore::Access::kReadWrite);
    MapContent content = store.LoadVersion("floor", VersionNumber(1))->content();
    const auto known_best =
        std::min_element(content.groups.begin(), content.groups.end(), [](auto& a, auto& b) {
          return a.modes[0].cov_p_map_landmark.trace() < b.modes[0].cov_p_map_landmark.trace();
        });
    const auto index = known_best - content.groups.begin();
    MapEdit duplicate;
    duplicate.kind = EditKind::kNewMode;
    duplicate.landmark = known_best->signature;
    duplicate.mode = ModeNumber(2);
    duplicate.p_map_landmark = known_best->modes[0].p_map_landmark + Eigen::Vector2d(0.03, 0.0);
    duplicate.sd_m = 0.03;
    EditedMap map(std::move(content), {});
    EXPECT_THAT(map.Apply(duplicate), IsOk());
    content = map.content();
    content.groups[static_cast<std::size_t>(index)].modes[1].last_seen = content.stamp;
    CommitOptions options;
    options.parent = VersionNumber(1);
    options.states_probabilities = false;
    EXPECT_THAT(store.Commit("floor", content, {}, options), IsOk());
    return duplicate.landmark.text();
  }

  static std::string Point(const Place& place) {
    return fmt::format("{:.6f},{:.6f}", place.x_m, place.y_m);
  }

  static constexpr char kEdited[] = "edited.db";
  static constexpr char kPlain[] = "plain.db";
  static World* world_;
};

World* EditScenarioTest::world_ = nullptr;

// The new name sorts as the old one, so that no sum is in another order.
TEST_F(EditScenarioTest, ALogWithTheOldNameMakesTheSameMapUpToTheName) {
  const std::string old = Places(kPlain).begin()->first;
  const std::string now = old + "-b";
  Edit({"rename", old, now});
  Build(kEdited, {1});
  Build(kPlain, {1});
  Json expected = Groups(kPlain);
  for (Json& group : expected) {
    if (group["signature"] == old) group["signature"] = now;
  }
  EXPECT_EQ(Groups(kEdited), expected);

  // A localizer that reads the old name, on the store and on a snapshot.
  const Arguments run = {"run", "--area", "floor", "--initial-pose", "auto", world_->Log(2)};
  const auto localize = [&](const Arguments& on) {
    Arguments arguments = run;
    arguments.insert(arguments.end(), on.begin(), on.end());
    return RunForJson("shiftmap-localizer", arguments);
  };
  const std::string snapshot = world_->File("snapshot.db");
  std::filesystem::remove(snapshot);
  RunForJson("shiftmap-inspect",
             {"export",
              "--snapshot",
              "--store",
              world_->File(kEdited),
              "--area",
              "floor",
              "--output",
              snapshot});
  Json probabilities = localize({"--store", world_->File(kPlain)})["mode_probabilities"];
  for (Json& group : probabilities) {
    if (group["signature"] == old) group["signature"] = now;
  }
  EXPECT_EQ(localize({"--store", world_->File(kEdited)})["mode_probabilities"], probabilities);
  EXPECT_EQ(localize({"--snapshot", snapshot})["mode_probabilities"], probabilities);

  // Taken back, the build stays and has the old name.
  const Json undone = Edit({"undo", "1"});
  EXPECT_FALSE(undone["version"].is_null());
  EXPECT_EQ(Groups(kEdited), Groups(kPlain));
}

TEST_F(EditScenarioTest, ARetiredLandmarkStaysOutOfBuildsUntilItIsTakenBack) {
  const std::string gone = Places(kPlain).begin()->first;
  Edit({"retire", gone});
  Build(kEdited, {1});
  EXPECT_TRUE(Group(kEdited, gone).is_null());
  Edit({"undo", "1"});
  EXPECT_EQ(Group(kEdited, gone)["modes"][0]["x_m"], Group("first.db", gone)["modes"][0]["x_m"]);
  Build(kEdited, {2});
  EXPECT_FALSE(Group(kEdited, gone).is_null());
}

TEST_F(EditScenarioTest, ControlPointsPutTheMapIntoTheSurveyedFrameAndBuildsKeepIt) {
  const std::map<std::string, Place> truth = TruePlaces();
  const std::map<std::string, Place> before = Places(kEdited);
  std::vector<std::string> surveyed;
  for (const auto& [signature, place] : before) {
    if (truth.contains(signature)) surveyed.push_back(signature);
  }
  ASSERT_GE(surveyed.size(), 8U);
  constexpr double kSd = 0.02;
  for (std::size_t i = 0; i < surveyed.size(); i += 3) {
    Edit({"control", surveyed[i], Point(truth.at(surveyed[i])), "--mode", "1", "--sd", "0.02"});
  }
  const auto worst = [&](std::size_t first, std::size_t step) {
    const std::map<std::string, Place> now = Places(kEdited);
    double distance = 0.0;
    for (std::size_t i = first; i < surveyed.size(); i += step) {
      distance = std::max(distance, Distance(now.at(surveyed[i]), truth.at(surveyed[i])));
    }
    return distance;
  };
  // The frame was the start of the first run, metres and a turn away.
  EXPECT_GT(Distance(before.at(surveyed[1]), truth.at(surveyed[1])), 1.0);
  EXPECT_LT(worst(0, 3), 3.0 * kSd);
  EXPECT_LT(worst(0, 1), 0.3);
  for (const int run : {1, 2}) {
    const Json build = Build(kEdited, {run});
    EXPECT_LT(worst(0, 3), 3.0 * kSd) << run;
    EXPECT_LT(worst(0, 1), 0.3) << run;
    EXPECT_EQ(build["waiting"].size(), 0U);
  }
}

// Runs of versions before control points, drawn on the version that has them: the picture, and
// with it the distance between a landmark and the run beside it, has the size that it had.
TEST_F(EditScenarioTest, EarlierRunsAreDrawnInTheFrameOfTheMap) {
  Build(kEdited, {1});
  const auto size = [&] {
    const std::string path = world_->File("map.svg");
    RunForJson(
        "shiftmap-inspect",
        {"plot", "map", "--store", world_->File(kEdited), "--area", "floor", "--output", path});
    const std::string svg = ReadFile(path);
    EXPECT_EQ(XmlDefect(svg), "");
    EXPECT_NE(svg.find("1 of earlier versions"), std::string::npos);
    return std::stod(svg.substr(svg.find("height=\"") + 8));
  };
  const double before = size();
  const std::map<std::string, Place> places = Places(kEdited);
  Place moved = places.begin()->second;
  moved.x_m += 300.0;
  Edit({"control", places.begin()->first, Point(moved), "--mode", "1", "--sd", "0.02"});
  EXPECT_NEAR(size(), before, 1.0);
  const Json diff = RunForJson(
      "shiftmap-inspect", {"diff", "2", "3", "--store", world_->File(kEdited), "--area", "floor"});
  EXPECT_NEAR(diff["frame_moved"]["x_m"].get<double>(), 300.0, 1e-6);
  EXPECT_EQ(diff["groups"], Json::array());
}

// The landmark stood at one place in the first run and metres away in the second: as one mode that
// is split they are two again, and the next build keeps both.
TEST_F(EditScenarioTest, ASplitModeStaysTwoInBuilds) {
  Build(kEdited, {1});
  const std::string signature = Places(kEdited).begin()->first;
  const Place first = Places(kEdited).at(signature);
  Place second = first;
  second.x_m += 1.5;
  const Json split = Edit(
      {"split", signature, "1", Point(first), Point(second), "--sd", "0.1", "--first", "run_000"});
  const int added = split["edit"]["second_mode"].get<int>();
  EXPECT_EQ(split["edit"]["first_runs"].size(), 1U);
  EXPECT_EQ(split["edit"]["second_runs"].size(), 0U);
  const Json build = Build(kEdited, {2});
  EXPECT_EQ(build["waiting"].size(), 0U);
  const Json group = Group(kEdited, signature);
  bool found = false;
  for (const Json& mode : group["modes"]) {
    if (mode["mode"] == added) {
      found = true;
      EXPECT_NEAR(mode["x_m"].get<double>(), second.x_m, 0.5);
    }
  }
  EXPECT_TRUE(found);
  const CommandResult undone = RunCommand("shiftmap-inspect", EditOf({"undo", "1"}));
  EXPECT_EQ(undone.exit_code, kAttention) << undone.err;
  Build(kEdited, {1, 2});
  Build(kPlain, {1, 2});
  EXPECT_EQ(Groups(kEdited).size(), Groups(kPlain).size());
  const Json verified =
      RunForJson("shiftmap-inspect", {"verify", "--store", world_->File(kEdited)});
  EXPECT_EQ(verified["defects"], 0);
}

TEST_F(EditScenarioTest, TwoModesAtOnePlaceAreOneInTheNextBuild) {
  const std::string signature = CommitDuplicate();
  ASSERT_EQ(Group(kEdited, signature)["modes"].size(),
            Group(kPlain, signature)["modes"].size() + 1);
  EXPECT_EQ(Build(kEdited, {1})["modes_merged"], 1);
  Build(kPlain, {1});
  const Json group = Group(kEdited, signature);
  const Json plain = Group(kPlain, signature);
  ASSERT_EQ(group["modes"].size(), plain["modes"].size());
  const Json diff = RunForJson(
      "shiftmap-inspect", {"diff", "2", "3", "--store", world_->File(kEdited), "--area", "floor"});
  const auto changed =
      std::find_if(diff.at("groups").begin(), diff.at("groups").end(), [&](const Json& of) {
        return of.at("signature") == signature;
      });
  ASSERT_NE(changed, diff.at("groups").end());
  EXPECT_EQ(changed->at("modes_merged").size(), 1U);
  const Json& mode = group["modes"].back();
  const Json& alone = plain["modes"].back();
  EXPECT_NEAR(mode["probability"].get<double>(), alone["probability"].get<double>(), 0.02);
  EXPECT_NEAR(mode["x_m"].get<double>(), alone["x_m"].get<double>(), 0.05);
  EXPECT_NEAR(mode["y_m"].get<double>(), alone["y_m"].get<double>(), 0.05);
  const Json verified =
      RunForJson("shiftmap-inspect", {"verify", "--store", world_->File(kEdited)});
  EXPECT_EQ(verified["defects"], 0);
}

TEST_F(EditScenarioTest, AMergeThatWasTakenBackIsNotMadeByABuild) {
  const std::string signature = CommitDuplicate();
  const std::size_t modes = Group(kEdited, signature)["modes"].size();
  Edit({"merge", signature, "2", "1"});
  Edit({"undo", "1"});
  EXPECT_EQ(Build(kEdited, {1})["modes_merged"], 0);
  EXPECT_EQ(Group(kEdited, signature)["modes"].size(), modes);
}

TEST_F(EditScenarioTest, WhatABuildWasMadeWithIsLeftOutOfTheNext) {
  const std::string signature = Places(kEdited).begin()->first;
  Place moved = Places(kEdited).at(signature);
  moved.x_m += 3.0;
  moved.y_m -= 2.0;
  Edit({"control", signature, Point(moved), "--mode", "1", "--sd", "0.02"});
  Build(kEdited, {1});
  EXPECT_LT(Distance(Places(kEdited).at(signature), moved), 0.02);

  const CommandResult undone = RunCommand("shiftmap-inspect", EditOf({"undo", "1"}));
  EXPECT_EQ(undone.exit_code, kAttention);
  EXPECT_NE(undone.err.find("was built on edit 1: the next build goes on without it"),
            std::string::npos)
      << undone.err;
  EXPECT_LT(Distance(Places(kEdited).at(signature), moved), 0.02);
  Build(kEdited, {1, 2});
  Build(kPlain, {1, 2});
  EXPECT_EQ(Groups(kEdited), Groups(kPlain));
}

TEST_F(EditScenarioTest, WithoutAStoredAncestorAnUndoSaysThatBuildsStartAnew) {
  const std::string signature = Places(kEdited).begin()->first;
  Edit({"control", signature, Point(Places(kEdited).at(signature)), "--mode", "1", "--sd", "0.02"});
  Build(kEdited, {1});
  RunForJson("shiftmap-inspect",
             {"compact", "--keep-versions", "1", "--store", world_->File(kEdited)});
  const CommandResult undone = RunCommand("shiftmap-inspect", EditOf({"undo", "1"}));
  EXPECT_EQ(undone.exit_code, kAttention);
  EXPECT_NE(undone.err.find("was built on edit 1: no stored ancestor is without it"),
            std::string::npos)
      << undone.err;
  const CommandResult built = RunCommand("shiftmap-mapper", world_->BuildOf(kEdited, {2}));
  EXPECT_NE(built.err.find("--prior none"), std::string::npos) << built.err;
}

// A name is taken back by itself; what a merge took away is in the map before it alone.
TEST_F(EditScenarioTest, CompactionLeavesNamesToBeTakenBack) {
  Edit({"rename", "L03", "gate"});
  Build(kEdited, {1});
  const Json before = Group(kEdited, "gate");
  ASSERT_FALSE(before.is_null());
  RunForJson("shiftmap-inspect",
             {"compact", "--keep-versions", "1", "--store", world_->File(kEdited)});
  Edit({"undo", "1"});
  EXPECT_TRUE(Group(kEdited, "gate").is_null());
  EXPECT_EQ(Group(kEdited, "L03")["modes"], before["modes"]);

  Edit({"retire", "L04"});
  Build(kEdited, {2});
  RunForJson("shiftmap-inspect",
             {"compact", "--keep-versions", "1", "--store", world_->File(kEdited)});
  ExpectError("shiftmap-inspect", EditOf({"undo", "2"}), 3, "edit 2 cannot be taken out");
}

TEST_F(EditScenarioTest, ARunThatFallsOutWithAnEditIsNamedUntilItIsGivenAgain) {
  const std::string signature = Places(kEdited).begin()->first;
  Place moved = Places(kEdited).at(signature);
  moved.x_m += 3.0;
  Edit({"control", signature, Point(moved), "--mode", "1", "--sd", "0.02"});
  Build(kEdited, {1});
  RunCommand("shiftmap-inspect", EditOf({"undo", "1"}));
  const CommandResult without = RunCommand("shiftmap-mapper", world_->BuildOf(kEdited, {2}));
  EXPECT_EQ(without.exit_code, kAttention);
  EXPECT_NE(without.err.find("run 'run_001' is no longer in the map"), std::string::npos)
      << without.err;
  const CommandResult with = RunCommand("shiftmap-mapper", world_->BuildOf(kEdited, {1}));
  EXPECT_EQ(with.exit_code, 0) << with.err;
}

TEST_F(EditScenarioTest, AStatedRateWeighsInEveryFitUntilItIsTakenBack) {
  const std::string signature = Places(kEdited).begin()->first;
  const auto rate = [&](const std::string& store) {
    return Group(store, signature)["leave_rate_per_s"].get<double>();
  };
  Edit({"rate", signature, "0.001", "--weight", "1000"});
  EXPECT_NEAR(rate(kEdited), 1e-3, 1e-5);
  Build(kEdited, {1});
  EXPECT_NEAR(rate(kEdited), 1e-3, 2e-5);
  const CommandResult undone = RunCommand("shiftmap-inspect", EditOf({"undo", "1"}));
  EXPECT_EQ(undone.exit_code, kAttention);
  Build(kEdited, {2});
  Build(kPlain, {1});
  Build(kPlain, {2});
  // The prior that all share was another one in the night between.
  EXPECT_NEAR(std::log(rate(kEdited) / rate(kPlain)), 0.0, 0.1);
  const Json verified =
      RunForJson("shiftmap-inspect", {"verify", "--store", world_->File(kEdited)});
  EXPECT_EQ(verified["defects"], 0);
}

// The place that went is 4 m from the mode that took it over.
TEST_F(EditScenarioTest, AControlPointOfAMergedModeDoesNotMoveTheNextBuild) {
  const std::map<std::string, Place> before = Places(kEdited);
  const auto& [signature, place] = *before.begin();
  const Place other = {place.x_m + 4.0, place.y_m};
  const Json added = Edit({"position", signature, Point(other), "--new", "--sd", "0.02"});
  const std::string mode = std::to_string(added["edit"]["mode"].get<int>());
  Edit({"control", signature, Point(other), "--mode", mode, "--sd", "0.02"});
  const CommandResult merged =
      RunCommand("shiftmap-inspect", EditOf({"merge", signature, mode, "1"}));
  EXPECT_EQ(merged.exit_code, kAttention) << merged.err;
  Build(kEdited, {1});
  for (const auto& [name, now] : Places(kEdited)) {
    if (!before.contains(name)) continue;
    EXPECT_LT(Distance(now, before.at(name)), 0.3) << name;
  }
}

// As a store has them whose control points were not checked against what came later.
TEST_F(EditScenarioTest, ABuildThatContradictsAControlPointIsHeldOnTheOthersAndSaysSo) {
  const std::map<std::string, Place> before = Places(kEdited);
  std::vector<std::string> surveyed;
  for (const auto& [signature, place] : before) surveyed.push_back(signature);
  for (const std::size_t i : {0U, 4U, 8U, 12U}) {
    Edit({"control", surveyed.at(i), Point(before.at(surveyed[i])), "--mode", "1", "--sd", "0.02"});
  }
  {
    StatusOr<Database> database =
        Database::Open(world_->File(kEdited), {Database::Mode::kReadWrite});
    ASSERT_THAT(database->Execute("UPDATE map_edit SET x_m = x_m + 3.0 WHERE edit_id = 2"), IsOk());
  }
  const CommandResult build = RunCommand("shiftmap-mapper", world_->BuildOf(kEdited, {1}));
  EXPECT_EQ(build.exit_code, kAttention);
  EXPECT_NE(build.err.find("control point '" + surveyed[4] + "': "), std::string::npos)
      << build.err;
  for (const auto& [name, now] : Places(kEdited)) {
    if (!before.contains(name)) continue;
    EXPECT_LT(Distance(now, before.at(name)), 0.3) << name;
  }
}

TEST_F(EditScenarioTest, ABuildWithoutAPriorNamesTheEditsAndRunsThatItLacks) {
  const std::string signature = Places(kEdited).begin()->first;
  Edit({"retire", signature});
  Edit({"rename", std::next(Places(kEdited).begin())->first, "gate"});
  Edit({"undo", "2"});
  Arguments anew = world_->BuildOf(kEdited, {1});
  anew.insert(anew.end(), {"--prior", "none"});
  const CommandResult build = RunCommand("shiftmap-mapper", anew);
  EXPECT_EQ(build.exit_code, kAttention);
  EXPECT_NE(build.err.find("edit 1 (retire '" + signature + "') is not in the new map"),
            std::string::npos)
      << build.err;
  EXPECT_NE(build.err.find("run 'run_000' is not in the new map"), std::string::npos) << build.err;
  EXPECT_EQ(CountLines(build.err), 2) << build.err;
}

}  // namespace
}  // namespace shiftmap::testing

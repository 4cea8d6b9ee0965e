// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/inspect/inspect_commands.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

struct Outcome {
  int code;
  std::string out;
  std::string err;

  Json json() const { return Json::parse(out); }
};

class EditCommands : public ::testing::Test {
 protected:
  void SetUp() override {
    std::mt19937_64 random(TestSeed(12));
    const MapContent content = RandomContent(random, {.groups = 4, .vehicles = 1});
    for (const LandmarkGroup& group : content.groups) names_.push_back(group.signature.text());
    vehicle_ = content.vehicles[0].vehicle;
    MapStore store = *MapStore::Open(store_, MapStore::Access::kReadWriteCreate);
    ASSERT_THAT(store.Commit("hall", content, {"test", "", 0, {}}, {}), IsOk());
  }

  Outcome Run(std::vector<std::string> arguments) { return Command("edit", std::move(arguments)); }
  Outcome Diff(std::vector<std::string> arguments) { return Command("diff", std::move(arguments)); }

  Outcome Command(const char* command, std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), command);
    arguments.insert(arguments.end(), {"--store", store_, "--area", "hall"});
    Application application("shiftmap-inspect", "");
    AddInspectCommands(&application);
    std::ostringstream out;
    std::ostringstream err;
    const ExitCode code = application.Run(arguments, &out, &err);
    return {static_cast<int>(code), out.str(), err.str()};
  }

  // With a reason.
  Outcome Edit(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--reason", "survey of May", "--author", "ann"});
    return Run(std::move(arguments));
  }

  TempDir dir_;
  const std::string store_ = dir_.File("maps.db");
  std::vector<std::string> names_;
  std::string vehicle_;
};

TEST_F(EditCommands, EveryKindIsMadeListedAndTakenBack) {
  const std::vector<std::vector<std::string>> edits = {
      {"position", names_[0], "1", "1.5,-2", "--sd", "0.02"},
      {"position", names_[0], "-3,4e0", "--new", "--sd", "0.1"},
      {"control", names_[1], "10,20", "--sd", "0.05", "--mode", "1"},
      {"retire", names_[2]},
      {"rename", names_[3], "gate"},
      {"rate", "gate", "1e-4", "--weight", "5"},
      {"calibration", "reset", vehicle_, "--since", "0"}};
  for (std::size_t i = 0; i < edits.size(); ++i) {
    const Outcome made = Edit(edits[i]);
    // The surveyed position is far from where the map has the mode.
    ASSERT_EQ(made.code, i == 0 ? 8 : 0) << i << made.err;
    EXPECT_THAT(made.out, HasSubstr("version " + std::to_string(i + 2) + " is published"));
  }
  const Json list = Run({"list", "--json"}).json();
  ASSERT_EQ(list["edits"].size(), edits.size());
  EXPECT_EQ(list["edits"][0]["kind"], "position");
  EXPECT_EQ(list["edits"][0]["x_m"], 1.5);
  EXPECT_EQ(list["edits"][0]["author"], "ann");
  EXPECT_EQ(list["edits"][0]["reason"], "survey of May");
  EXPECT_EQ(list["edits"][1]["y_m"], 4.0);
  EXPECT_EQ(list["edits"][4]["new_name"], "gate");
  EXPECT_EQ(list["edits"][5]["weight"], 5.0);
  EXPECT_EQ(list["edits"][6]["vehicle"], vehicle_);
  for (std::size_t i = edits.size(); i-- > 0;) {
    const Outcome undone = Edit({"undo", std::to_string(i + 1), "--json"});
    ASSERT_EQ(undone.code, 0) << i << undone.err;
    EXPECT_EQ(undone.json()["edit"]["undone"]["author"], "ann");
  }
  EXPECT_THAT(Run({"list"}).out, HasSubstr("taken back "));
}

TEST_F(EditCommands, TheListSaysWhatIsInThePublishedMap) {
  const auto state = [&](bool in_map, const std::string& text) {
    EXPECT_EQ(Run({"list", "--json"}).json()["edits"][0]["in_published_map"], in_map);
    EXPECT_THAT(Run({"list"}).out, HasSubstr(text));
  };
  ASSERT_EQ(Edit({"control", names_[1], "10,20", "--sd", "0.05", "--mode", "1"}).code, 0);
  state(true, "in force");
  ASSERT_EQ(Command("rollback", {}).code, 0);
  state(false, "not in the published map");
  EXPECT_THAT(Run({"list"}).out, Not(HasSubstr("in force")));
  ASSERT_EQ(Command("publish", {"2"}).code, 0);
  state(true, "in force");
  {
    MapStore store = *MapStore::Open(store_, MapStore::Access::kReadWrite);
    const MapSnapshot map = *store.LoadVersion("hall", VersionNumber(2));
    CommitOptions options;
    options.parent = VersionNumber(2);
    ASSERT_THAT(store.Commit("hall", map.content(), {"test", "", 0, {}}, options), IsOk());
  }
  ASSERT_EQ(Edit({"undo", "1"}).code, 8);
  state(true, "taken back, still in the published map");
  ASSERT_EQ(Command("rollback", {"1"}).code, 0);
  state(false, "taken back  ");
}

TEST_F(EditCommands, ACalibrationIsForgottenSinceATimeInAnyForm) {
  const Outcome made =
      Edit({"calibration", "reset", vehicle_, "--since", "2026-01-07T06:00Z", "--json"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_EQ(made.json()["edit"]["since_s"], 1767765600.0);
}

// A landmark may have been entered wrongly: the edit holds, and a person is told.
TEST_F(EditCommands, APositionFarFromWhereRunsSawTheModeIsSaid) {
  const Mode before = *MapStore::Open(store_, MapStore::Access::kReadOnly)
                           ->LoadAt("hall")
                           ->groups()[0]
                           .modes.begin();
  const auto place = [&](double by_m) {
    return Edit({"position",
                 names_[0],
                 std::to_string(before.number.value()),
                 fmt::format("{},{}", before.p_map_landmark.x(), before.p_map_landmark.y() + by_m),
                 "--sd",
                 "0.1",
                 "--json"});
  };
  const Outcome far = place(217.0);
  EXPECT_EQ(far.code, 8);
  EXPECT_NEAR(far.json()["moved_m"].get<double>(), 217.0, 1e-9);
  EXPECT_EQ(far.json()["version"], 2);
  EXPECT_THAT(far.err, HasSubstr("of '" + names_[0] + "' moves by 217.000 m, "));
  ASSERT_EQ(Edit({"undo", "1"}).code, 0);
  const Outcome near = place(0.1);
  EXPECT_EQ(near.code, 0) << near.err;
  EXPECT_NEAR(near.json()["moved_m"].get<double>(), 0.1, 1e-9);
}

// What does not fit is refused before anything is written, and in a dry run.
TEST_F(EditCommands, AControlPointThatContradictsAnotherIsRefused) {
  const std::vector<LandmarkGroup> groups =
      MapStore::Open(store_, MapStore::Access::kReadOnly)->LoadAt("hall")->groups();
  const auto control = [&](std::size_t i, double by_m) {
    const Mode& mode = groups[i].modes[0];
    return std::vector<std::string>{
        "control",
        names_[i],
        fmt::format(
            "{},{}", mode.p_map_landmark.x() + 500.0, mode.p_map_landmark.y() + 500.0 + by_m),
        "--sd",
        "0.02",
        "--mode",
        std::to_string(mode.number.value())};
  };
  for (const std::size_t i : {0u, 1u, 2u}) {
    const Outcome made = Edit(control(i, 0.0));
    ASSERT_EQ(made.code, 0) << made.err;
  }
  const std::string before = *HashFile(store_);
  for (const bool dry_run : {true, false}) {
    std::vector<std::string> mistyped = control(3, 300.0);
    if (dry_run) mistyped.push_back("--dry-run");
    const Outcome refused = Edit(mistyped);
    EXPECT_EQ(refused.code, 3);
    EXPECT_THAT(refused.err, HasSubstr("control point '" + names_[3] + "': "));
    EXPECT_EQ(std::count(refused.err.begin(), refused.err.end(), '\n'), 1) << refused.err;
    EXPECT_EQ(*HashFile(store_), before);
  }
  EXPECT_EQ(Edit(control(3, 0.0)).code, 0);
}

TEST_F(EditCommands, AMergedModeIsPartOfTheOther) {
  ASSERT_EQ(Edit({"position", names_[0], "1,1", "--new", "--sd", "0.1"}).code, 0);
  const Json list = Run({"list", "--json"}).json();
  const std::string added = std::to_string(list["edits"][0]["mode"].get<int>());
  const Outcome merged = Edit({"merge", names_[0], added, "1", "--json"});
  ASSERT_EQ(merged.code, 0) << merged.err;
  EXPECT_EQ(merged.json()["edit"]["into"], 1);
  EXPECT_EQ(merged.json()["version"], 3);
}

TEST_F(EditCommands, AControlPointThatAMergeReleasesIsNamed) {
  ASSERT_EQ(Edit({"position", names_[0], "1,1", "--new", "--sd", "0.1"}).code, 0);
  const Json list = Run({"list", "--json"}).json();
  const std::string added = std::to_string(list["edits"][0]["mode"].get<int>());
  ASSERT_EQ(Edit({"control", names_[0], "1,1", "--mode", added, "--sd", "0.02"}).code, 0);
  const Outcome merged = Edit({"merge", names_[0], added, "1", "--json"});
  EXPECT_EQ(merged.code, 8);
  EXPECT_EQ(merged.json()["released"], Json::array({2}));
  EXPECT_THAT(merged.err,
              HasSubstr("control point 2 no longer holds: its mode " + added + " of '" + names_[0] +
                        "' is merged"));
}

// The position came first: the control points were surveyed on a map that had it.
TEST_F(EditCommands, WhatMakesControlPointsContradictTheMapIsRefused) {
  const std::vector<LandmarkGroup> groups =
      MapStore::Open(store_, MapStore::Access::kReadOnly)->LoadAt("hall")->groups();
  const auto at = [&](std::size_t i, double by_m) {
    const Mode& mode = groups[i].modes[0];
    return fmt::format("{},{}", mode.p_map_landmark.x(), mode.p_map_landmark.y() + by_m);
  };
  const auto number = [&](std::size_t i) {
    return std::to_string(groups[i].modes[0].number.value());
  };
  ASSERT_EQ(Edit({"position", names_[0], number(0), at(0, 30.0), "--sd", "0.02"}).code, 8);
  for (const std::size_t i : {0u, 1u, 2u, 3u}) {
    const Outcome made = Edit(
        {"control", names_[i], at(i, i == 0 ? 30.0 : 0.0), "--sd", "0.02", "--mode", number(i)});
    ASSERT_EQ(made.code, 0) << made.err;
  }
  const std::string before = *HashFile(store_);
  const Outcome moved = Edit({"position", names_[0], number(0), at(0, 60.0), "--sd", "0.02"});
  EXPECT_EQ(moved.code, 3);
  EXPECT_THAT(moved.err, HasSubstr("control point '" + names_[0] + "': "));
  const Outcome undone = Edit({"undo", "1"});
  EXPECT_NE(undone.code, 0);
  EXPECT_THAT(undone.err, HasSubstr("edit 1: another one needs it: edit "));
  EXPECT_EQ(*HashFile(store_), before);
}

TEST_F(EditCommands, ASplitModeIsTwoModes) {
  const Outcome split = Edit({"split", names_[0], "1", "1,2", "-3,4", "--sd", "0.1", "--json"});
  ASSERT_EQ(split.code, 0) << split.err;
  const Json edit = split.json()["edit"];
  EXPECT_EQ(edit["mode"], 1);
  EXPECT_EQ(edit["x_m"], 1.0);
  EXPECT_EQ(edit["second_x_m"], -3.0);
  EXPECT_GT(edit["second_mode"], 1);
  EXPECT_EQ(edit["first_runs"], Json::array());
  EXPECT_THAT(Run({"list"}).out,
              HasSubstr("mode 1 of '" + names_[0] + "' split: mode 1 at (1.000, 2.000) m, mode " +
                        std::to_string(edit["second_mode"].get<int>()) + " at (-3.000, 4.000) m"));
  EXPECT_THAT(Diff({"1", "2"}).out, HasSubstr("new mode"));
  EXPECT_THAT(Edit({"undo", "1"}).out, HasSubstr("taken back"));
}

// One line each, and nothing else of them.
TEST_F(EditCommands, ARenameAndAMovedFrameAreNoChangesOfLandmarks) {
  ASSERT_EQ(Edit({"rename", names_[0], "zz-gate"}).code, 0);
  const Outcome renamed = Diff({"1", "2"});
  ASSERT_EQ(renamed.code, 0) << renamed.err;
  EXPECT_THAT(renamed.out, HasSubstr("edit 1: '" + names_[0] + "' renamed 'zz-gate'"));
  EXPECT_EQ(renamed.out.find("gone"), std::string::npos) << renamed.out;
  EXPECT_EQ(renamed.out.find("new landmark"), std::string::npos) << renamed.out;
  const Json json = Diff({"1", "2", "--json"}).json();
  EXPECT_EQ(json["renamed"], (Json::array({{{"from", names_[0]}, {"to", "zz-gate"}}})));
  EXPECT_EQ(json["groups_added"], Json::array());
  EXPECT_EQ(json["frame_moved"], nullptr);

  ASSERT_EQ(Edit({"control", names_[1], "500,-200", "--sd", "0.05", "--mode", "1"}).code, 0);
  const Outcome moved = Diff({"1", "3"});
  ASSERT_EQ(moved.code, 0) << moved.err;
  EXPECT_THAT(moved.out, HasSubstr("the frame moved by ("));
  EXPECT_EQ(moved.out.find("standard deviations"), std::string::npos) << moved.out;
  EXPECT_EQ(Diff({"1", "3", "--json"}).json()["groups"], Json::array());
  EXPECT_FALSE(Diff({"1", "3", "--json"}).json()["frame_moved"].is_null());
}

TEST_F(EditCommands, ADryRunSaysItAndWritesNothing) {
  const std::string before = *HashFile(store_);
  const Outcome outcome = Edit({"rename", names_[0], "gate", "--dry-run"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("renamed 'gate'"));
  EXPECT_EQ(*HashFile(store_), before);
  EXPECT_EQ(Edit({"rename", "nobody", "gate", "--dry-run"}).code, 6);
}

TEST_F(EditCommands, WhatMakesNoSenseIsAUsageError) {
  for (const std::vector<std::string>& words :
       std::vector<std::vector<std::string>>{{"position", names_[0], "1", "1.5"},
                                             {"position", names_[0], "1", "1,2"},
                                             {"position", names_[0], "1", "1,2,3", "--sd", "1"},
                                             {"position", names_[0], "0", "1,2", "--sd", "1"},
                                             {"control", names_[0], "north", "--sd", "1"},
                                             {"rename", names_[0]},
                                             {"retire"},
                                             {"retire", names_[0], "--sd", "1"},
                                             {"rate", names_[0], "often"},
                                             {"calibration", "forget", vehicle_, "--since", "0"},
                                             {"calibration", "reset", vehicle_},
                                             {"undo", "first"},
                                             {"split", names_[0]},
                                             {"split", names_[0], "1", "1,2", "3,4"},
                                             {"split", names_[0], "1", "1,2", "--sd", "1"},
                                             {"retire", names_[0], "--first", "a"},
                                             {"divide", names_[0]}}) {
    EXPECT_EQ(Edit(words).code, 2) << words[0];
  }
  EXPECT_EQ(Run({"retire", names_[0]}).code, 2);
  EXPECT_EQ(Run({"retire", names_[0], "--reason", ""}).code, 2);
}

TEST_F(EditCommands, HostileInputIsOneClearLine) {
  const auto expect = [&](const std::vector<std::string>& words, int code, const char* text) {
    const Outcome outcome = Edit(words);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(text));
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_EQ(outcome.err.find('\x1b'), std::string::npos);
    EXPECT_EQ(outcome.out, "");
  };
  expect({"position", names_[0], "1", "nan,2", "--sd", "1"}, 3, "position (nan, 2)");
  expect({"control", names_[0], "1,inf", "--sd", "1"}, 3, "position (1, inf)");
  expect({"control", names_[0], "1,2", "--sd", "0"}, 3, "standard deviation 0 m");
  expect({"control", names_[0], "1,2", "--sd", "-1"}, 3, "standard deviation -1 m");
  expect({"rate", names_[0], "0"}, 3, "rate 0 per s");
  expect({"rate", names_[0], "1", "--weight", "0"}, 3, "weight 0");
  expect({"retire", "\x1b[31mred"}, 6, "no landmark '\\x1b[31mred'");
  expect({"rename", names_[0], "a\x1b[2Jb"}, 3, "new name: 'a\\x1b[2Jb'");
  expect({"rename", names_[0], std::string(2000, 'x')}, 3, "2000 bytes");
  expect({"calibration", "reset", "nobody", "--since", "0"}, 6, "vehicle 'nobody'");
  expect({"undo", "7"}, 6, "no edit 7");
  expect({"position", names_[0], "99", "1,2", "--sd", "1"}, 6, "no mode 99");
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
//
// Simulated shifts in a mine, through the programs as a user runs them.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/scenario/command.h"
#include "tests/scenario/well_formed.h"
#include "tests/scenario/world.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

class MineTest : public ::testing::Test {
 protected:
  // `mine` into the folder "mine", with more options.
  Arguments Mine(const Arguments& more) const {
    Arguments arguments = {"mine",
                           Folder(),
                           "--length-m",
                           "80",
                           "--drawpoints",
                           "4",
                           "--crosscuts",
                           "1",
                           "--tags",
                           "10"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }

  std::string Folder() const { return dir_.File("mine"); }
  std::string File(const std::string& name) const { return Folder() + "/" + name; }

  TempDir dir_;
};

TEST_F(MineTest, AMapOfTwoShiftsHasItsLandmarksWhereTheyStand) {
  const Json report = RunForJson(
      "shiftmap-sim", Mine({"--shifts", "2", "--mode-change-probability", "0", "--seed", "3"}));
  EXPECT_EQ(report["groups"], 11);
  ASSERT_EQ(report["runs"].size(), 2U);
  EXPECT_EQ(report["runs"][1]["path"], File("run_001.mcap"));
  EXPECT_GT(report["runs"][1]["observations"], 300);
  const std::string store = dir_.File("maps.db");
  const Json map = RunForJson(
      "shiftmap-mapper",
      {"build", "--store", store, "--area", "mine", File("run_000.mcap"), File("run_001.mcap")});
  EXPECT_EQ(map["groups"], 11);
  const Json error = RunForJson(
      "shiftmap-eval", {"map", "--store", store, "--area", "mine", File("run_000.places.csv")});
  EXPECT_EQ(error["matched"], 11);
  EXPECT_LT(error["rmse_m"], 0.1);
}

// Scans of the lidar go from the log into the views of the tree engine and of the localizer.
TEST_F(MineTest, TheTreeEngineMapsAndTheLocalizerDrivesByWhatTheLidarCovers) {
  RunForJson("shiftmap-sim", Mine({"--shifts", "3", "--seed", "3", "--keep-scans"}));
  const std::string store = dir_.File("maps.db");
  Arguments build = {
      "build", "--store", store, "--area", "mine", "--field-of-view", "scan-polygon"};
  build.insert(build.end(), {File("run_000.mcap"), File("run_001.mcap")});
  ExpectError("shiftmap-mapper", build, 2, "--field-of-view scan-polygon");
  build[5] = "--tree-insertion";
  build[6] = "child";
  ExpectError("shiftmap-mapper", build, 2, "--engine graph has no tree");
  build[5] = "--field-of-view";
  build[6] = "scan-polygon";
  build.insert(build.end(), {"--engine", "tree"});
  const Json map = RunForJson("shiftmap-mapper", build);
  EXPECT_EQ(map["runs"].size(), 2U);
  const Json error = RunForJson(
      "shiftmap-eval", {"map", "--store", store, "--area", "mine", File("run_001.places.csv")});
  EXPECT_EQ(error["matched"], 11);
  EXPECT_LT(error["rmse_m"], 0.3);
  const Json shift = RunForJson("shiftmap-localizer",
                                {"run",
                                 "--store",
                                 store,
                                 "--area",
                                 "mine",
                                 "--field-of-view",
                                 "scan-polygon",
                                 File("run_002.mcap")});
  EXPECT_GT(shift["frames_by_lidar"], 100);
}

TEST_F(MineTest, WritesThePlanBesideTheRuns) {
  RunForJson("shiftmap-sim", Mine({"--shifts", "1", "--points", "--sign-corners"}));
  EXPECT_GT(ReadCsv(File("plan.csv")).size(), 200U);
  EXPECT_EQ(XmlDefect(ReadFile(File("plan.svg"))), "");
  // A barrier with three places, three corners with two, ten tags with two.
  EXPECT_EQ(ReadCsv(File("truth.csv")).size(), 3U + 6U + 20U);
  EXPECT_EQ(ReadCsv(File("modes.csv")).size(), 14U);
}

TEST_F(MineTest, SaysWhatIsWrong) {
  ExpectError("shiftmap-sim", Mine({"--path", "1;2"}), 2, "--path '1;2'");
  ExpectError("shiftmap-sim", Mine({"--window", "1,2"}), 2, "--window '1,2'");
  ExpectError("shiftmap-sim", Mine({"--plan", "site.json"}), 2, "needs --window");
  ExpectError("shiftmap-sim", Mine({"--sign-corners"}), 2, "needs --points");
  ExpectError("shiftmap-sim", Mine({"--path", "0,6", "--path", "30,6"}), 3, "crosses a wall");
  ExpectError("shiftmap-sim", Mine({"--mode-gap-m", "50"}), 3, "do not fit");
  ExpectError("shiftmap-sim",
              Mine({"--plan",
                    dir_.File("site.json"),
                    "--window",
                    "0,0,9,9",
                    "--path",
                    "1,1",
                    "--path",
                    "2,2"}),
              6,
              "site.json");
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
//
// The loop between shifts: localize, return, build, in any order.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

class FleetLoopTest : public ::testing::TestWithParam<int> {
 protected:
  FleetLoopTest() : world_(RestlessSite(GetParam())) {
    RunForJson("shiftmap-mapper", world_.BuildOf("start.db", {0, 1}));
  }

  // Localizes a run on the map of the first two and keeps its report.
  void Localize(int run) const {
    RunForJson("shiftmap-localizer",
               {"run",
                "--store",
                world_.File("start.db"),
                "--area",
                "floor",
                "--report",
                Report(run),
                world_.Log(run)});
  }

  std::string Report(int run) const { return world_.File(std::to_string(run) + ".report"); }

  // A store to which steps were applied: run numbers are returned, "build N" is built.
  std::string After(const std::string& name, const std::vector<std::string>& steps) const {
    std::filesystem::copy_file(world_.File("start.db"), world_.File(name));
    for (const std::string& step : steps) {
      const int run = step.back() - '0';
      if (step.starts_with("return")) {
        RunForJson("shiftmap-localizer", {"return", "--store", world_.File(name), Report(run)});
      } else {
        RunForJson("shiftmap-mapper", world_.BuildOf(name, {run}));
      }
    }
    return name;
  }

  Json Show(const std::string& store) const {
    // At a time of its own, so that no clock matters.
    return RunForJson(
        "shiftmap-inspect",
        {"show", "--store", world_.File(store), "--area", "floor", "--at", "1768000000", "--json"});
  }

  World world_;
};

// The log and the report about it are the same visits: whichever comes first, they count once, as
// the build has them.
TEST_P(FleetLoopTest, AReportBeforeTheBuildOfItsLogChangesNothing) {
  Localize(2);
  const Json alone = Show(After("alone.db", {"build 2"}));
  const Json before = Show(After("before.db", {"return 2", "build 2"}));
  const Json after = Show(After("after.db", {"build 2", "return 2"}));
  EXPECT_EQ(before["content_hash"], alone["content_hash"]);
  EXPECT_EQ(before["groups"], alone["groups"]);
  EXPECT_EQ(after["groups"], alone["groups"]);
}

TEST_P(FleetLoopTest, AReportOfAnotherShiftCountsInAnyOrder) {
  Localize(2);
  Localize(3);
  const Json first = Show(After("first.db", {"return 3", "return 2", "build 2"}));
  const Json last = Show(After("last.db", {"return 2", "return 3", "build 2"}));
  const Json without = Show(After("without.db", {"return 3", "build 2"}));
  EXPECT_EQ(first["content_hash"], last["content_hash"]);
  EXPECT_EQ(first["groups"], last["groups"]);
  EXPECT_EQ(first["groups"], without["groups"]);
}

// Landmarks that the build saw stand where it saw them, and are not away.
TEST_P(FleetLoopTest, LandmarksThatTheBuildSawAreNotAbsent) {
  Localize(2);
  const Json groups = Show(After("loop.db", {"return 2", "build 2"}))["groups"];
  const double end = 1767600000.0 + 2 * 86400.0;
  int seen = 0;
  for (const Json& group : groups) {
    double last = 0.0;
    double known = 0.0;
    for (const Json& mode : group["modes"]) {
      if (mode["mode"] == 0) continue;
      last = std::max(last, mode["last_seen_s"].get<double>());
      known += mode["probability"].get<double>();
    }
    if (last < end) continue;
    ++seen;
    EXPECT_GT(known, 0.5) << group["signature"];
  }
  EXPECT_GT(seen, 10);
}

INSTANTIATE_TEST_SUITE_P(Worlds, FleetLoopTest, ::testing::Values(21, 23, 25));

}  // namespace
}  // namespace shiftmap::testing

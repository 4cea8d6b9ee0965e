// SPDX-License-Identifier: Apache-2.0
//
// A run that may lie at several places in the map waits: the store remembers it, builds name it,
// and the one that is given its log when others have decided takes it up.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "mapstore/map/sha256.h"
#include "mapstore/run/trajectory.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

constexpr int kDone = 0;
constexpr int kNothingToDo = 5;
constexpr int kAttention = 8;

// Of the second run's seven landmarks in common with the first, three stayed.
class WaitingRunsTest : public ::testing::Test {
 protected:
  CommandResult Build(const std::vector<int>& runs, Arguments more = {}) const {
    Arguments words = {"build", "--json", "--store", world_.File("maps.db"), "--area", "floor"};
    words.insert(words.end(), more.begin(), more.end());
    for (const int run : runs) words.push_back(world_.Log(run));
    return RunCommand("shiftmap-mapper", words);
  }

  // What a build of these runs says of runs that wait.
  Json Waiting(const std::vector<int>& runs, int exit_code) const {
    const CommandResult built = Build(runs);
    EXPECT_EQ(built.exit_code, exit_code) << built.err;
    return Json::parse(built.out)["waiting"];
  }

  World world_{RestlessSite(24)};
};

TEST_F(WaitingRunsTest, AreRememberedUntilTheyAreTakenUp) {
  const CommandResult first = Build({0, 1});
  ASSERT_EQ(first.exit_code, kAttention) << first.err;
  EXPECT_NE(first.err.find("run 'run_001' waits: either L05, L07 and L16 stayed"),
            std::string::npos)
      << first.err;
  EXPECT_EQ(CountLines(first.err), 1) << first.err;
  const Json document = Json::parse(first.out);
  EXPECT_EQ(document["runs"].size(), 1u);
  ASSERT_EQ(document["ambiguous_changes"].size(), 1u);
  const Json& change = document["ambiguous_changes"][0];
  EXPECT_EQ(change["runs"], Json::array({"run_001"}));
  EXPECT_GE(change["explanations"].size(), 2u);
  EXPECT_FALSE(change["deciding"].empty());

  // A build of it alone has nothing else to do.
  EXPECT_EQ(Waiting({1}, kNothingToDo).size(), 1u);

  // Nor does one that starts anew forget it.
  const CommandResult anew = Build({2}, {"--prior", "none", "--dry-run"});
  ASSERT_EQ(anew.exit_code, kAttention) << anew.err;  // It lacks a run of the published map.
  EXPECT_EQ(Json::parse(anew.out)["waiting"][0]["run"], "run_001");

  const Json elsewhere = Waiting({2}, kDone);
  ASSERT_EQ(elsewhere.size(), 1u);
  EXPECT_EQ(elsewhere[0]["run"], "run_001");
  EXPECT_NE(elsewhere[0]["reason"].get<std::string>().find("was not given"), std::string::npos);

  EXPECT_EQ(Waiting({1}, kDone).size(), 0u);
  EXPECT_EQ(Waiting({3}, kDone).size(), 0u);
  const Json errors =
      RunForJson("shiftmap-eval",
                 {"map", "--store", world_.File("maps.db"), "--area", "floor", world_.Places()});
  // A place is in the map, or was never seen and is far from the others of its landmark.
  for (const Json& place : errors["places"]) {
    const double distance_m = place["distance_m"].get<double>();
    EXPECT_TRUE(distance_m < 0.4 || distance_m > 2.0) << place.dump();
  }

  // Before it was taken up it waits again.
  for (int i = 0; i < 2; ++i) {
    RunForJson("shiftmap-inspect",
               {"rollback", "--store", world_.File("maps.db"), "--area", "floor"});
  }
  EXPECT_EQ(Waiting({3}, kDone).size(), 1u);
}

// By signature where the only mode of each landmark is in a map of its own area.
std::map<std::string, Eigen::Vector2d> PlacesOf(const std::string& store, const std::string& area) {
  std::map<std::string, Eigen::Vector2d> places;
  const Json map = RunForJson("shiftmap-inspect", {"show", "--store", store, "--area", area});
  for (const Json& group : map["groups"]) {
    const Json& mode = group["modes"][1];
    places[group["signature"]] = {mode["x_m"].get<double>(), mode["y_m"].get<double>()};
  }
  return places;
}

// What operations advise where further runs do not decide: three landmarks that moved, surveyed.
TEST_F(WaitingRunsTest, ASurveyOfThreeMovedLandmarksDecides) {
  const std::string store = world_.File("maps.db");
  ASSERT_EQ(Build({0}).exit_code, kDone);
  ASSERT_EQ(Waiting({1}, kNothingToDo).size(), 1u);
  RunForJson("shiftmap-mapper", {"build", "--store", store, "--area", "own", world_.Log(1)});
  const auto before = PlacesOf(store, "floor");
  const auto after = PlacesOf(store, "own");
  std::vector<PointPair> stayed;
  for (const char* name : {"L05", "L07", "L16"}) {
    stayed.push_back({before.at(name), after.at(name)});
  }
  const StatusOr<Se2> T_before_after = AlignRigid2d(stayed);
  ASSERT_TRUE(T_before_after.ok());
  int surveyed = 0;
  for (const auto& [name, place] : after) {
    const Eigen::Vector2d p = *T_before_after * place;
    if (surveyed == 3 || !before.contains(name) || (before.at(name) - p).norm() < 1.0) continue;
    ++surveyed;
    RunForJson("shiftmap-inspect",
               {"edit",
                "position",
                name,
                fmt::format("{},{}", p.x(), p.y()),
                "--new",
                "--sd",
                "0.1",
                "--reason",
                "survey",
                "--store",
                store,
                "--area",
                "floor"});
  }
  ASSERT_EQ(surveyed, 3);
  EXPECT_EQ(Waiting({1}, kDone).size(), 0u);
}

// A log that was deleted, or lies elsewhere: the run does not come by itself.
TEST_F(WaitingRunsTest, ANightNamesThoseWhoseLogIsNotThere) {
  const std::string logs = world_.File("logs");
  std::filesystem::create_directory(logs);
  for (const int run : {0, 1}) {
    std::filesystem::copy_file(world_.Log(run), fmt::format("{}/{}.mcap", logs, run));
  }
  const auto night = [&] {
    return RunCommand("shiftmap-mapper",
                      {"nightly",
                       "--store",
                       world_.File("maps.db"),
                       "--logs",
                       logs,
                       "--area",
                       "floor",
                       "--min-age-s",
                       "0"});
  };
  night();
  EXPECT_NE(night().err.find("1.mcap' waits"), std::string::npos);
  const std::string missing = "run '1' waits since";
  EXPECT_EQ(night().err.find(missing), std::string::npos);
  const std::string hash = *HashFile(logs + "/1.mcap");
  std::filesystem::remove(logs + "/1.mcap");
  CommandResult named = night();
  EXPECT_EQ(named.exit_code, kAttention);
  EXPECT_NE(named.err.find(missing), std::string::npos) << named.err;
  EXPECT_NE(named.err.find("runs exclude " + hash), std::string::npos) << named.err;
  std::filesystem::remove(logs + "/0.mcap");
  named = night();
  EXPECT_NE(named.err.find(missing), std::string::npos) << named.err;
  RunForJson("shiftmap-inspect",
             {"runs",
              "exclude",
              hash,
              "--store",
              world_.File("maps.db"),
              "--area",
              "floor",
              "--reason",
              "gone"});
  EXPECT_EQ(night().exit_code, kNothingToDo);
}

TEST_F(WaitingRunsTest, NothingIsRememberedOfADryRun) {
  ASSERT_EQ(Build({0}).exit_code, kDone);
  EXPECT_EQ(Build({1}, {"--dry-run"}).exit_code, kNothingToDo);
  EXPECT_EQ(Waiting({2}, kDone).size(), 0u);
}

TEST_F(WaitingRunsTest, APlaceByConsensusWaitsForNothing) {
  EXPECT_EQ(Build({0, 1}, {"--placement", "consensus"}).exit_code, kDone);
}

}  // namespace
}  // namespace shiftmap::testing

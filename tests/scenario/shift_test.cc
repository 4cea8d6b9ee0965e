// SPDX-License-Identifier: Apache-2.0
//
// A simulated week: a map from the first shifts, then shifts that drive on it and hand back what
// they learned. Truth is the simulator's.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "mapstore/codec/run_log.h"
#include "mapstore/geometry/se2.h"
#include "tests/scenario/command.h"
#include "tests/scenario/well_formed.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

constexpr int kMappedShifts = 4;
constexpr int kShifts = 7;

// A mode of the map this close to a true place is that place.
constexpr double kSamePlaceM = 0.5;

// Fewer observations than these may be outliers; they need not decide anything.
constexpr int kClearlySeen = 8;

Stamp EndOf(const RunLog& log) { return log.run.odometry.back().stamp; }

class ShiftTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    week_ = new World({"--shifts",
                       std::to_string(kShifts),
                       "--seed",
                       "11",
                       "--groups",
                       "14",
                       "--size-m",
                       "25",
                       "--duration-s",
                       "120",
                       "--mode-change-probability",
                       "0.4",
                       "--odometry-scale-v",
                       "0.95",
                       "--odometry-lag-s",
                       "0.1"});
    Arguments build = {"build", "--store", week_->File("built.db"), "--area", "floor"};
    for (int shift = 0; shift < kMappedShifts; ++shift) build.push_back(week_->Log(shift));
    built_ = new Json(RunForJson("shiftmap-mapper", build));
    const Json error =
        RunForJson("shiftmap-eval",
                   {"map", "--store", week_->File("built.db"), "--area", "floor", week_->Places()});
    const Json& pose = error["T_truth_map"];
    T_truth_map_ = Se2(pose[0], pose[1], pose[2]);
  }
  static void TearDownTestSuite() {
    delete built_;
    delete week_;
  }

  ShiftTest() : store_(CopyOfStore("maps.db")) {}

  std::string CopyOfStore(const std::string& name) const {
    std::filesystem::copy_file(week_->File("built.db"), folder_.File(name));
    return folder_.File(name);
  }

  static Arguments Of(const std::string& store, Arguments words) {
    words.insert(words.end(), {"--store", store, "--area", "floor"});
    return words;
  }

  static RunLog Log(int shift) {
    StatusOr<RunLog> log = ReadRunLog(week_->Log(shift));
    EXPECT_TRUE(log.ok()) << Message(log.status());
    return *std::move(log);
  }

  Json Localize(int shift, Arguments more = {}) const {
    more.insert(more.begin(), {"run", week_->Log(shift)});
    return RunForJson("shiftmap-localizer", Of(store_, more));
  }

  Json Show(Arguments more = {}) const {
    more.insert(more.begin(), "show");
    return RunForJson("shiftmap-inspect", Of(store_, more));
  }

  // The map as it was at the end of a shift.
  Json ShowAfter(int shift) const {
    return Show({"--at", fmt::format("{:.6f}", ToSecondsSinceEpoch(EndOf(Log(shift))))});
  }

  // Number of the map's mode that is a true place; 0 if the map does not know the place.
  static int ModeAt(const Json& group, const Eigen::Vector2d& p_truth) {
    const Eigen::Vector2d p_map = T_truth_map_.Inverse() * p_truth;
    for (const Json& mode : group["modes"]) {
      if (mode["mode"] == 0) continue;
      const Eigen::Vector2d p_mode(mode["x_m"].get<double>(), mode["y_m"].get<double>());
      if ((p_mode - p_map).norm() < kSamePlaceM) return mode["mode"];
    }
    return 0;
  }

  static int TopMode(const Json& group) {
    int top = -1;
    double best = -1.0;
    for (const Json& mode : group["modes"]) {
      const double probability = mode["probability"];
      if (probability > best) {
        best = probability;
        top = mode["mode"];
      }
    }
    return top;
  }

  // Where every landmark stood in a shift.
  static std::map<std::string, Eigen::Vector2d> TruePlaces(int shift) {
    std::map<std::pair<std::string, int>, Eigen::Vector2d> places;
    for (const auto& row : ReadCsv(week_->Places())) {
      places[{row.at(0), std::stoi(row.at(1))}] =
          Eigen::Vector2d(std::stod(row.at(2)), std::stod(row.at(3)));
    }
    std::map<std::string, Eigen::Vector2d> stood;
    for (const World::TrueMode& truth : week_->Modes(shift)) {
      stood[truth.signature] = places.at({truth.signature, truth.mode});
    }
    return stood;
  }

  // For every landmark that a shift saw clearly, the mode on top is where it stood.
  static void ExpectLayout(const Json& map, int shift) {
    std::map<std::string, int> seen;
    for (const Scan& scan : Log(shift).run.scans) {
      for (const Observation& observation : scan.observations) {
        ++seen[observation.signature.text()];
      }
    }
    const auto places = TruePlaces(shift);
    int compared = 0;
    for (const Json& group : map["groups"]) {
      const std::string signature = group["signature"];
      if (seen[signature] < kClearlySeen) continue;
      EXPECT_EQ(TopMode(group), ModeAt(group, places.at(signature)))
          << "landmark " << signature << " in shift " << shift;
      ++compared;
    }
    EXPECT_GE(compared, 10) << "shift " << shift;
  }

  static Json* built_;
  static World* week_;
  static Se2 T_truth_map_;
  TempDir folder_;
  std::string store_;
};

Json* ShiftTest::built_ = nullptr;
World* ShiftTest::week_ = nullptr;
Se2 ShiftTest::T_truth_map_;

// Latencies and the report's name are the only things that differ from call to call.
Json WithoutChance(Json document) {
  document.erase("latency_ms");
  document.erase("report_uuid");
  return document;
}

TEST_F(ShiftTest, MapHasThePlacesOfTheTruth) {
  const Json map = ShowAfter(kMappedShifts - 1);
  int places = 0;
  int known = 0;
  for (int shift = 0; shift < kMappedShifts; ++shift) {
    for (const auto& [signature, place] : TruePlaces(shift)) {
      for (const Json& group : map["groups"]) {
        if (group["signature"] != signature) continue;
        ++places;
        if (ModeAt(group, place) != 0) ++known;
      }
    }
  }
  EXPECT_GE(known, places * 95 / 100);
  ExpectLayout(map, kMappedShifts - 1);
}

TEST_F(ShiftTest, EveryShiftBringsTheLayoutUpToDate) {
  for (int shift = kMappedShifts; shift < kShifts; ++shift) {
    const Json run = Localize(shift, {"--return"});
    EXPECT_EQ(run["states"]["LOST"], 0.0);
    EXPECT_FALSE(run["decisions"].empty());
    ExpectLayout(ShowAfter(shift), shift);
  }
  // What came later does not change what held then.
  for (int shift = kMappedShifts; shift < kShifts; ++shift) {
    ExpectLayout(ShowAfter(shift), shift);
  }
}

TEST_F(ShiftTest, PlacesThatTheMapDoesNotKnowAreReported) {
  Localize(kMappedShifts, {"--return"});
  const Json map = ShowAfter(kMappedShifts);
  const Json sightings = RunForJson("shiftmap-inspect", Of(store_, {"sightings"}))["sightings"];
  const auto places = TruePlaces(kMappedShifts);
  int found = 0;
  for (const Json& sighting : sightings) {
    const Eigen::Vector2d p_map(sighting["x_m"].get<double>(), sighting["y_m"].get<double>());
    const Eigen::Vector2d p_truth = T_truth_map_ * p_map;
    EXPECT_LT((p_truth - places.at(sighting["signature"])).norm(), 2 * kSamePlaceM) << sighting;
    ++found;
  }
  for (const Json& group : map["groups"]) {
    if (TopMode(group) == 0) --found;
  }
  EXPECT_EQ(found, 0) << sightings;
}

TEST_F(ShiftTest, ReportsCountTheSameInAnyOrder) {
  std::vector<std::string> reports;
  for (int shift = kMappedShifts; shift < kShifts; ++shift) {
    reports.push_back(folder_.File(fmt::format("{}.report", shift)));
    Localize(shift, {"--report", reports.back()});
  }
  const Json before = ShowAfter(kShifts - 1);
  const std::string other = CopyOfStore("other.db");
  for (const std::size_t i : {0, 1, 2}) {
    RunForJson("shiftmap-localizer", {"return", "--store", store_, reports[i]});
  }
  RunForJson("shiftmap-localizer", {"return", "--store", other, reports[2], reports[0]});
  RunForJson("shiftmap-localizer", {"return", "--store", other, reports[1]});
  const Json in_order = ShowAfter(kShifts - 1);
  store_ = other;
  const Json shuffled = ShowAfter(kShifts - 1);
  EXPECT_NE(in_order, before);
  EXPECT_EQ(in_order["stamp_s"], shuffled["stamp_s"]);
  ASSERT_EQ(in_order["groups"].size(), shuffled["groups"].size());
  for (std::size_t g = 0; g < in_order["groups"].size(); ++g) {
    const Json& a = in_order["groups"][g]["modes"];
    const Json& b = shuffled["groups"][g]["modes"];
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t m = 0; m < a.size(); ++m) {
      EXPECT_NEAR(a[m]["probability"].get<double>(), b[m]["probability"].get<double>(), 1e-12);
    }
  }
}

TEST_F(ShiftTest, SnapshotIsAsGoodAsTheStore) {
  Localize(kMappedShifts, {"--return"});
  const std::string snapshot = folder_.File("vehicle.db");
  RunForJson("shiftmap-inspect", Of(store_, {"export", "--snapshot", "--output", snapshot}));
  const Json on_store = Localize(kMappedShifts + 1);
  const Json on_snapshot =
      RunForJson("shiftmap-localizer",
                 {"run", "--snapshot", snapshot, "--area", "floor", week_->Log(kMappedShifts + 1)});
  EXPECT_EQ(WithoutChance(on_store), WithoutChance(on_snapshot));
}

TEST_F(ShiftTest, PipeIsAsGoodAsTheFile) {
  const Json from_file = Localize(kMappedShifts);
  const Json from_pipe = RunForJson("shiftmap-localizer",
                                    Of(store_, {"run", "-"}),
                                    {.input = ReadFile(week_->Log(kMappedShifts))});
  EXPECT_EQ(WithoutChance(from_file), WithoutChance(from_pipe));
}

TEST_F(ShiftTest, AGapCountsForNoState) {
  shiftmap::Run run = Log(kMappedShifts).run;
  const double duration_s = ToSeconds(run.odometry.back().stamp - run.odometry.front().stamp);
  const Stamp middle = run.odometry[run.odometry.size() / 2].stamp;
  const auto let_wait = [&](auto* items) {
    for (auto& item : *items) {
      if (item.stamp >= middle) item.stamp += std::chrono::hours(1);
    }
  };
  let_wait(&run.odometry);
  let_wait(&run.scans);
  const std::string path = folder_.File("gap.mcap");
  ASSERT_TRUE(WriteRunLog(run, path).ok());
  const CommandResult result =
      RunCommand("shiftmap-localizer", Of(store_, {"run", "--json", path}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.err.find("1 gap without odometry and scans"), std::string::npos) << result.err;
  const Json document = Json::parse(result.out);
  EXPECT_EQ(document["gaps"]["count"], 1);
  EXPECT_NEAR(document["gaps"]["seconds"].get<double>(), 3597.0, 1.0);
  double told_s = 0.0;
  for (const Json& seconds : document["states"]) told_s += seconds.get<double>();
  EXPECT_NEAR(told_s, duration_s + 3.0, 1.0);
}

TEST_F(ShiftTest, NextNightKeepsTheModeNumbers) {
  const Json before = Show();
  const Json build =
      RunForJson("shiftmap-mapper",
                 Of(store_, {"build", week_->Log(kMappedShifts), week_->Log(kMappedShifts + 1)}));
  EXPECT_EQ(build["version"], 2);
  const Json after = ShowAfter(kMappedShifts + 1);
  EXPECT_EQ(after["version"], 2);
  EXPECT_EQ(after["parent"], 1);
  std::map<std::pair<std::string, int>, Eigen::Vector2d> places;
  for (const Json& group : after["groups"]) {
    for (const Json& mode : group["modes"]) {
      if (mode["mode"] == 0) continue;
      places[{group["signature"], mode["mode"]}] =
          Eigen::Vector2d(mode["x_m"].get<double>(), mode["y_m"].get<double>());
    }
  }
  for (const Json& group : before["groups"]) {
    for (const Json& mode : group["modes"]) {
      if (mode["mode"] == 0) continue;
      const auto found = places.find({group["signature"], mode["mode"]});
      ASSERT_NE(found, places.end()) << group["signature"] << " mode " << mode["mode"];
      const Eigen::Vector2d p(mode["x_m"].get<double>(), mode["y_m"].get<double>());
      EXPECT_LT((found->second - p).norm(), kSamePlaceM) << group["signature"];
    }
  }
  ExpectLayout(after, kMappedShifts + 1);
}

TEST_F(ShiftTest, VersionsSayWhatIsPublished) {
  const auto published = [&] {
    std::vector<int> numbers;
    const Json document = RunForJson("shiftmap-inspect", Of(store_, {"versions"}));
    for (const Json& version : document["versions"]) {
      if (version["published"]) numbers.push_back(version["version"]);
    }
    return numbers;
  };
  EXPECT_EQ(published(), std::vector<int>{1});
  const Json held =
      RunForJson("shiftmap-mapper", Of(store_, {"build", "--no-publish", week_->Log(4)}));
  EXPECT_EQ(held["version"], 2);
  EXPECT_EQ(published(), std::vector<int>{1});
  EXPECT_EQ(Show()["version"], 1);
  EXPECT_EQ(Show()["content_hash"], (*built_)["content_hash"]);

  const Json second = RunForJson("shiftmap-mapper", Of(store_, {"build", week_->Log(5)}));
  EXPECT_EQ(second["version"], 3);
  EXPECT_EQ(published(), std::vector<int>{3});
  const Json versions = RunForJson("shiftmap-inspect", Of(store_, {"versions"}))["versions"];
  ASSERT_EQ(versions.size(), 3u);
  EXPECT_EQ(versions[0]["parent"], nullptr);
  EXPECT_EQ(versions[1]["parent"], 1);
  EXPECT_EQ(versions[2]["parent"], 1);
  EXPECT_EQ(versions[1]["content_hash"], held["content_hash"]);
  EXPECT_EQ(versions[2]["content_hash"], second["content_hash"]);
  const Json areas = RunForJson("shiftmap-inspect", {"areas", "--store", store_})["areas"];
  EXPECT_EQ(areas[0]["published"], 3);
  EXPECT_EQ(areas[0]["versions"], 3);
}

TEST_F(ShiftTest, SameRunsGiveTheSameMapInAnyOrder) {
  Arguments build = {"build", "--store", folder_.File("again.db"), "--area", "floor"};
  for (int shift = kMappedShifts - 1; shift >= 0; --shift) build.push_back(week_->Log(shift));
  EXPECT_EQ(RunForJson("shiftmap-mapper", build)["content_hash"], (*built_)["content_hash"]);
}

TEST_F(ShiftTest, RunThatIsInTheMapAlreadyIsNothingToDo) {
  constexpr int kNothingToDo = 5;
  ExpectError("shiftmap-mapper", Of(store_, {"build", week_->Log(0)}), kNothingToDo, "'floor'");
}

TEST_F(ShiftTest, TrajectoriesAreTrueAndInOrder) {
  const std::string path = folder_.File("shift.tum");
  for (int shift = kMappedShifts; shift < kShifts; ++shift) {
    Localize(shift, {"--trajectory", path});
    std::istringstream lines(ReadFile(path));
    double previous = 0.0;
    int poses = 0;
    for (std::string line; std::getline(lines, line); ++poses) {
      const double stamp_s = std::stod(line);
      EXPECT_GT(stamp_s, previous) << "line " << poses + 1;
      previous = stamp_s;
    }
    EXPECT_GT(poses, 500);
    const Json error =
        RunForJson("shiftmap-eval", {"trajectory", path, week_->Truth(shift), "--align"});
    EXPECT_EQ(error["matched"], poses);
    EXPECT_LT(error["position_rmse_m"], 0.2) << "shift " << shift;
    EXPECT_LT(error["yaw_rmse_rad"], 0.05) << "shift " << shift;
  }
}

TEST_F(ShiftTest, MapperWritesTrajectoriesToo) {
  const std::string folder = folder_.File("trajectories");
  RunForJson("shiftmap-mapper",
             Of(folder_.File("second.db"),
                {"build", "--trajectories", folder, week_->Log(0), week_->Log(1)}));
  for (const int shift : {0, 1}) {
    const Json error = RunForJson("shiftmap-eval",
                                  {"trajectory",
                                   fmt::format("{}/run_{:03}.tum", folder, shift),
                                   week_->Truth(shift),
                                   "--align"});
    EXPECT_LT(error["position_rmse_m"], 0.2) << "shift " << shift;
  }
}

// The logs of two vehicles may have one name, but not what is made of them in one folder. The same
// log named twice is one.
TEST_F(ShiftTest, NoTrajectoryTakesThePlaceOfAnother) {
  constexpr int kBadInput = 3;
  const std::string folder = folder_.File("trajectories");
  const std::string other = folder_.File("run_000.mcap");
  std::filesystem::copy_file(week_->Log(1), other);
  const std::string store = folder_.File("second.db");
  ExpectError("shiftmap-mapper",
              Of(store, {"build", "--trajectories", folder, week_->Log(0), other}),
              kBadInput,
              other);
  EXPECT_FALSE(std::filesystem::exists(folder));
  EXPECT_FALSE(std::filesystem::exists(store));
  RunForJson("shiftmap-mapper",
             Of(store, {"build", "--trajectories", folder, week_->Log(0), week_->Log(0)}));
}

TEST_F(ShiftTest, PlotIsWellFormed) {
  const std::string recording = folder_.File("recording.mcap");
  const std::string trajectory = folder_.File("shift.tum");
  const std::string truth = week_->Truth(kMappedShifts);
  Localize(kMappedShifts, {"--return", "--recording", recording, "--trajectory", trajectory});
  const auto draw = [&](Arguments words) {
    const std::string path = folder_.File(words[0] + ".svg");
    words.insert(words.begin(), "plot");
    words.insert(words.end(), {"--output", path});
    RunForJson("shiftmap-inspect", Of(store_, words));
    const std::string svg = ReadFile(path);
    EXPECT_EQ(XmlDefect(svg), "") << words[1];
    return svg;
  };
  const std::string map = draw({"map"});
  const std::string rates = draw({"rates"});
  for (const World::TrueMode& mode : week_->Modes(0)) {
    EXPECT_NE(map.find(mode.signature), std::string::npos) << mode.signature;
    EXPECT_NE(rates.find(mode.signature), std::string::npos) << mode.signature;
  }
  draw({"night"});
  draw({"modes", week_->Modes(0)[0].signature});
  EXPECT_NE(draw({"history", week_->Modes(0)[0].signature}).find("mode 1"), std::string::npos);
  EXPECT_NE(draw({"trajectory", trajectory, "--truth", truth, "--align"}).find("rmse 0."),
            std::string::npos);
  EXPECT_NE(draw({"consistency", recording, "--truth", truth, "--align"}).find("NEES"),
            std::string::npos);
}

// The scales of ranges, odometry and map make up for each other: nothing but their priors keeps
// them from drifting together.
TEST(LongShift, IsAsExactAtItsEndAsAtItsBegin) {
  for (const char* seed : {"1", "2"}) {
    const World world({"--shifts",
                       "2",
                       "--vehicles",
                       "1",
                       "--mode-change-probability",
                       "0",
                       "--size-m",
                       "28",
                       "--duration-s",
                       "4800",
                       "--seed",
                       seed});
    const std::string store = world.File("maps.db");
    RunForJson("shiftmap-mapper", world.BuildOf("maps.db", {0}));
    const std::string driven = world.File("driven.tum");
    RunForJson("shiftmap-localizer",
               {"run", "--store", store, "--area", "floor", "--trajectory", driven, world.Log(1)});
    const Json error =
        RunForJson("shiftmap-eval", {"trajectory", driven, world.Truth(1), "--align"});
    EXPECT_LT(error["position_rmse_m"], 0.1) << "seed " << seed;
  }
}

// Nobody knows how large a site is to better than the scale of its sensors: metres at its edge.
// Among the landmarks around it the vehicle knows where it is.
TEST(WideSite, TheVehicleIsNotLostAtItsEdge) {
  for (const char* seed : {"1", "2", "3"}) {
    const World world({"--shifts",
                       "3",
                       "--vehicles",
                       "1",
                       "--mode-change-probability",
                       "0.1",
                       "--size-m",
                       "500",
                       "--groups",
                       "140",
                       "--max-range-m",
                       "40",
                       "--duration-s",
                       "500",
                       "--speed-mps",
                       "4",
                       "--scan-rate-hz",
                       "4",
                       "--seed",
                       seed});
    RunForJson("shiftmap-mapper", world.BuildOf("maps.db", {0, 1}));
    const Json shift =
        RunForJson("shiftmap-localizer",
                   {"run", "--store", world.File("maps.db"), "--area", "floor", world.Log(2)});
    EXPECT_LT(shift["states"]["LOST"], 100.0) << "seed " << seed;
  }
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
//
// A build that is stopped, or that is too large, leaves nothing behind; runs that are of no use are
// named and left out.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <thread>

#include "mapstore/codec/run_log.h"
#include "tests/scenario/background_command.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

constexpr int kBadInput = 3;
constexpr int kStopped = 130;

std::vector<std::string> FilesIn(const std::string& folder) {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    files.push_back(entry.path().filename().string());
  }
  std::sort(files.begin(), files.end());
  return files;
}

class BuildLimits : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new World({"--shifts", "3", "--duration-s", "60", "--groups", "10", "--size-m", "20"});
    large_ = new World({"--shifts", "2", "--duration-s", "1200", "--groups", "60"});
  }
  static void TearDownTestSuite() {
    delete world_;
    delete large_;
    world_ = nullptr;
    large_ = nullptr;
  }

  Arguments Build(const Arguments& rest) const {
    Arguments words = {"build", "--store", store_, "--area", "floor"};
    words.insert(words.end(), rest.begin(), rest.end());
    return words;
  }

  // A log of a run, beside the store.
  std::string Log(const std::string& name, const shiftmap::Run& run) const {
    const std::string path = folder_.File(name);
    EXPECT_TRUE(WriteRunLog(run, path).ok());
    return path;
  }

  static shiftmap::Run ReadShift(int shift) {
    StatusOr<RunLog> log = ReadRunLog(world_->Log(shift));
    EXPECT_TRUE(log.ok()) << Message(log.status());
    return log.ok() ? std::move(log->run) : shiftmap::Run();
  }

  static World* world_;  // Small and quick.
  static World* large_;  // Builds for seconds.
  TempDir folder_;
  std::string store_ = folder_.File("maps.db");
};

World* BuildLimits::world_ = nullptr;
World* BuildLimits::large_ = nullptr;

TEST_F(BuildLimits, AStoppedBuildLeavesNothing) {
  RunForJson("shiftmap-mapper", Build({world_->Log(0)}));
  const std::string before = ReadFile(store_);
  const std::vector<std::string> files = FilesIn(folder_.path());
  for (const int signal : {SIGINT, SIGTERM}) {
    for (const int delay_ms : {0, 100, 300}) {
      BackgroundCommand build("shiftmap-mapper",
                              Build({"--prior",
                                     "none",
                                     "--trajectories",
                                     folder_.File("poses"),
                                     large_->Log(0),
                                     large_->Log(1)}));
      build.WaitUntilItCatches(signal);
      std::this_thread::sleep_for(std::chrono::milliseconds(delay_ms));
      const auto asked = std::chrono::steady_clock::now();
      EXPECT_EQ(build.End(signal), kStopped);
      EXPECT_LT(std::chrono::steady_clock::now() - asked, std::chrono::seconds(5 * kSlowdown));
      EXPECT_EQ(build.Errors(),
                std::string("shiftmap-mapper: area 'floor': build stopped by ") +
                    (signal == SIGINT ? "SIGINT" : "SIGTERM") + ", nothing is written\n");
    }
  }
  EXPECT_EQ(ReadFile(store_), before);
  EXPECT_EQ(FilesIn(folder_.path()), files);
}

TEST_F(BuildLimits, TooMuchMemoryIsRefused) {
  ExpectError("shiftmap-mapper",
              Build({"--max-memory-mib", "20", large_->Log(0)}),
              kBadInput,
              "allowed are");
  EXPECT_TRUE(FilesIn(folder_.path()).empty());
}

// The estimate is neither hit nor far off.
TEST_F(BuildLimits, TheEstimateOfMemoryHolds) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer takes memory of its own";
#endif
  constexpr int kShifts = 24;
  const World many({"--shifts",
                    std::to_string(kShifts),
                    "--duration-s",
                    "100",
                    "--groups",
                    "300",
                    "--size-m",
                    "60",
                    "--scan-rate-hz",
                    "1",
                    "--speed-mps",
                    "2.5"});
  Arguments of_many;
  for (int shift = 0; shift < kShifts; ++shift) of_many.push_back(many.Log(shift));
  for (const Arguments& logs : {Arguments{world_->Log(0)}, Arguments{large_->Log(0)}, of_many}) {
    Arguments words = {"--dry-run", "--json"};
    words.insert(words.end(), logs.begin(), logs.end());
    BackgroundCommand build("shiftmap-mapper", Build(words));
    ASSERT_EQ(build.End(0), 0);
    const auto estimate = Json::parse(build.Output())["estimated_memory_mib"].get<double>();
    std::printf("estimated %.1f MiB, taken %.1f MiB\n", estimate, build.PeakMib());
    EXPECT_GT(estimate, build.PeakMib());
    EXPECT_LT(estimate, 2.5 * build.PeakMib());
  }
}

TEST_F(BuildLimits, ARunOfAnotherAreaIsNamedAndLeftOut) {
  const World other({"--seed",
                     "98",
                     "--shifts",
                     "1",
                     "--duration-s",
                     "60",
                     "--groups",
                     "10",
                     "--size-m",
                     "20",
                     "--start-s",
                     "1767601000"});
  const std::string stranger = folder_.File("stranger.mcap");
  std::filesystem::copy_file(other.Log(0), stranger);
  const CommandResult built =
      RunCommand("shiftmap-mapper", Build({"--json", world_->Log(0), stranger, world_->Log(1)}));
  EXPECT_EQ(built.exit_code, 0) << built.err;
  EXPECT_EQ(CountLines(built.err), 1) << built.err;
  EXPECT_NE(built.err.find("run 'stranger' is left out: no consistent alignment"),
            std::string::npos)
      << built.err;
  const Json document = Json::parse(built.out);
  EXPECT_EQ(document["runs"].size(), 2u);
  EXPECT_EQ(document["rejected"][0]["run"], "stranger");
  // Against the map that is there now, it is alone.
  ExpectError("shiftmap-mapper", Build({stranger}), kBadInput, "run 'stranger'");
}

TEST_F(BuildLimits, ARunWithoutObservationsIsNamedAndLeftOut) {
  shiftmap::Run run = ReadShift(1);
  for (Scan& scan : run.scans) scan.observations.clear();
  const std::string blind = Log("blind.mcap", run);
  run.scans.clear();
  const std::string scanless = Log("scanless.mcap", run);
  ExpectError("shiftmap-mapper", Build({blind}), kBadInput, "run 'blind'");
  ExpectError("shiftmap-mapper", Build({scanless}), kBadInput, "run 'scanless'");
  const CommandResult built =
      RunCommand("shiftmap-mapper", Build({"--json", blind, world_->Log(0), scanless}));
  EXPECT_EQ(built.exit_code, 0) << built.err;
  EXPECT_EQ(CountLines(built.err), 2) << built.err;
  const Json document = Json::parse(built.out);
  EXPECT_EQ(document["runs"].size(), 1u);
  EXPECT_EQ(document["rejected"].size(), 2u);
}

TEST_F(BuildLimits, ALandmarkSeenOnceIsNone) {
  shiftmap::Run run = ReadShift(0);
  const auto seeing = std::find_if(run.scans.begin(), run.scans.end(), [](const Scan& scan) {
    return !scan.observations.empty();
  });
  ASSERT_NE(seeing, run.scans.end());
  Observation once = seeing->observations.front();
  once.signature = Signature("ONCE");
  seeing->observations.push_back(once);
  const Json with = RunForJson("shiftmap-mapper", Build({"--dry-run", Log("once.mcap", run)}));
  const Json without = RunForJson("shiftmap-mapper", Build({"--dry-run", world_->Log(0)}));
  EXPECT_EQ(with["modes_per_group"], without["modes_per_group"]);
}

// A logger that writes everything twice.
TEST_F(BuildLimits, StampsThatComeTwiceAreUsed) {
  const shiftmap::Run run = ReadShift(0);
  shiftmap::Run twice;
  twice.info = run.info;
  for (const OdometrySample& sample : run.odometry) {
    twice.odometry.insert(twice.odometry.end(), {sample, sample});
  }
  for (const Scan& scan : run.scans) twice.scans.insert(twice.scans.end(), {scan, scan});
  const Json doubled =
      RunForJson("shiftmap-mapper", Build({"--dry-run", Log("twice.mcap", twice)}));
  const Json once = RunForJson("shiftmap-mapper", Build({"--dry-run", world_->Log(0)}));
  EXPECT_EQ(doubled["modes_per_group"], once["modes_per_group"]);
}

// Two landmarks with one barcode: scans that see both say nothing of it, and the others stay right.
TEST_F(BuildLimits, ASignatureUsedTwiceHarmsNoOther) {
  shiftmap::Run run = ReadShift(0);
  const Json without = RunForJson("shiftmap-mapper", Build({"--dry-run", world_->Log(0)}));
  const std::vector<World::TrueMode> modes = world_->Modes(0);
  ASSERT_GE(modes.size(), 2u);
  const std::string twice = modes[0].signature;
  const std::string gone = modes[1].signature;
  for (Scan& scan : run.scans) {
    for (Observation& observation : scan.observations) {
      if (observation.signature == Signature(gone)) observation.signature = Signature(twice);
    }
  }
  const CommandResult built =
      RunCommand("shiftmap-mapper", Build({"--dry-run", "--json", Log("twice.mcap", run)}));
  ASSERT_EQ(built.exit_code, 0) << built.err;
  EXPECT_NE(built.err.find("run 'twice': "), std::string::npos) << built.err;
  EXPECT_NE(built.err.find("at two places in one scan"), std::string::npos) << built.err;
  const Json document = Json::parse(built.out);
  EXPECT_GT(document["runs"][0]["duplicate_observations"], 0);
  for (const auto& [signature, count] : without["modes_per_group"].items()) {
    if (signature == twice || signature == gone) continue;
    EXPECT_EQ(document["modes_per_group"][signature], count) << signature;
  }
}

}  // namespace
}  // namespace shiftmap::testing

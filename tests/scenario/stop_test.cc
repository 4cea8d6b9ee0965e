// SPDX-License-Identifier: Apache-2.0
//
// What a signal stops leaves its outputs whole or absent.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "tests/scenario/background_command.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

constexpr int kDone = 0;
constexpr int kStopped = 130;

std::string NameOf(int signal) { return signal == SIGINT ? "SIGINT" : "SIGTERM"; }

class StopTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ =
        new World({"--shifts", "2", "--duration-s", "600", "--groups", "20", "--size-m", "25"});
    RunForJson("shiftmap-mapper", world_->BuildOf("built.db", {0}));
  }
  static void TearDownTestSuite() { delete world_; }

  StopTest() { std::filesystem::copy_file(world_->File("built.db"), store_); }

  // A shift with everything that it can write.
  Arguments RunOf(const std::string& log) const {
    return {"run",
            "--store",
            store_,
            "--area",
            "floor",
            "--json",
            "--return",
            "--report",
            folder_.File("shift.report"),
            "--trajectory",
            folder_.File("shift.tum"),
            "--recording",
            folder_.File("shift.mcap"),
            log};
  }

  std::vector<std::string> Files() const {
    std::vector<std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) {
      files.push_back(entry.path().filename().string());
    }
    std::sort(files.begin(), files.end());
    return files;
  }

  static World* world_;
  TempDir folder_;
  std::string store_ = folder_.File("maps.db");
};

World* StopTest::world_ = nullptr;

TEST_F(StopTest, ARunOfALogLeavesNothing) {
  const std::string before = ReadFile(store_);
  const std::vector<std::string> files = Files();
  for (const int signal : {SIGINT, SIGTERM}) {
    BackgroundCommand run("shiftmap-localizer", RunOf(world_->Log(1)));
    run.WaitUntilItCatches(signal);
    EXPECT_EQ(run.End(signal), kStopped);
    EXPECT_EQ(run.Errors(),
              "shiftmap-localizer: run log '" + world_->Log(1) + "': run stopped by " +
                  NameOf(signal) + ", nothing is written\n");
  }
  EXPECT_EQ(ReadFile(store_), before);
  EXPECT_EQ(Files(), files);
}

// The pipe stays open: nothing but the signal ends the shift.
TEST_F(StopTest, AStreamEndsAsAShift) {
  const std::string pipe = folder_.File("pipe");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  BackgroundCommand run("shiftmap-localizer", RunOf("-"), {}, pipe);
  const int to = open(pipe.c_str(), O_WRONLY | O_CLOEXEC);
  ASSERT_GE(to, 0);
  const std::string bytes = ReadFile(world_->Log(1));
  const std::size_t half = bytes.size() / 2;
  for (std::size_t sent = 0; sent < half;) {
    const ssize_t more = write(to, bytes.data() + sent, half - sent);
    ASSERT_GT(more, 0);
    sent += static_cast<std::size_t>(more);
  }
  EXPECT_EQ(run.End(SIGTERM), kDone);
  close(to);
  EXPECT_NE(run.Errors().find("stopped by SIGTERM"), std::string::npos) << run.Errors();
  const Json document = Json::parse(run.Output());
  EXPECT_EQ(document["truncated"], true);
  const StatusOr<ShiftReport> report = ReadShiftReport(folder_.File("shift.report"));
  ASSERT_TRUE(report.ok()) << Message(report.status());
  EXPECT_EQ(report->uuid, document["report_uuid"]);
  EXPECT_FALSE(report->evidence.empty());
  const StatusOr<RunLog> log = ReadRunLog(world_->Log(1));
  EXPECT_LT(report->end, log->run.odometry.back().stamp - FromSeconds(60.0));
  const Json reports =
      RunForJson("shiftmap-inspect", {"reports", "--store", store_, "--area", "floor"});
  EXPECT_EQ(reports["reports"].size(), 1U);
  EXPECT_EQ(
      Files(),
      (std::vector<std::string>{"maps.db", "pipe", "shift.mcap", "shift.report", "shift.tum"}));
}

TEST_F(StopTest, ASimulationLeavesNothing) {
  for (const char* kind : {"open", "mine"}) {
    const std::string folder = folder_.File(kind);
    BackgroundCommand sim("shiftmap-sim", {kind, folder, "--shifts", "1000"});
    sim.WaitUntilItCatches(SIGTERM);
    EXPECT_EQ(sim.End(SIGTERM), kStopped);
    EXPECT_EQ(sim.Errors(),
              "shiftmap-sim: folder '" + folder +
                  "': simulation stopped by SIGTERM, nothing is written\n");
    EXPECT_FALSE(std::filesystem::exists(folder));
  }
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "localizer/live/client.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "tests/scenario/background_command.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {

inline constexpr int kDone = 0;
inline constexpr int kBadInput = 3;
inline constexpr int kNothingToDo = 5;
inline constexpr int kNotFound = 6;
inline constexpr int kTemporary = 75;

using Clock = std::chrono::steady_clock;

/// A map of two simulated shifts, a third to drive, and a service on that map.
class LiveTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new World({"--shifts", "3", "--seed", "11", "--groups", "14", "--size-m", "25"});
    RunForJson("shiftmap-mapper",
               {"build",
                "--store",
                world_->File("maps.db"),
                "--area",
                "floor",
                world_->Log(0),
                world_->Log(1)});
    const StatusOr<RunLog> log = ReadRunLog(world_->Log(2));
    ASSERT_TRUE(log.ok()) << Message(log.status());
    items_ = new std::vector<RunEvent>(MergeEvents(log->run));
  }
  static void TearDownTestSuite() {
    delete items_;
    delete world_;
  }

  LiveTest() : socket_(folder_.File("s")) {}

  static Arguments OnMap(Arguments words) {
    words.insert(words.end(), {"--store", world_->File("maps.db"), "--area", "floor"});
    return words;
  }

  Arguments Serve() const {
    return OnMap({"serve", "--socket", socket_, "--max-delay-s", max_delay_s_});
  }

  // A service that answers.
  std::unique_ptr<BackgroundCommand> Served(Arguments more = {},
                                            const std::vector<std::string>& environment = {}) {
    Arguments words = Serve();
    words.insert(words.end(), more.begin(), more.end());
    return Answering(words, environment);
  }

  std::unique_ptr<BackgroundCommand> Answering(const Arguments& words,
                                               const std::vector<std::string>& environment = {}) {
    auto service = std::make_unique<BackgroundCommand>("shiftmap-localizer", words, environment);
    const auto deadline = Clock::now() + std::chrono::seconds(20);
    while (Clock::now() < deadline) {
      auto client = live::Client::Connect(socket_);
      if (client.ok() && client->Call(live::GetState()).ok()) return service;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    ADD_FAILURE() << "no answer: " << service->Errors();
    return service;
  }

  live::Client Connected() const {
    StatusOr<live::Client> client = live::Client::Connect(socket_);
    EXPECT_THAT(client, IsOk());
    return *std::move(client);
  }

  static live::ServiceState Call(live::Client* client, const live::Command& command) {
    const StatusOr<live::Reply> reply = client->Call(command);
    EXPECT_THAT(reply, IsOk());
    return reply.ok() && reply->state ? *reply->state : live::ServiceState();
  }

  // Items [begin, end) of the shift; returns once they were taken.
  static live::ServiceState Feed(live::Client* client, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const live::Command command =
          std::visit([](const auto& item) { return live::Command(item); }, items_->at(i));
      EXPECT_THAT(client->Send({.id = 0, .command = command}), IsOk());
    }
    return Call(client, live::GetState());
  }

  // What a report says about the shift, without its name and the vehicle's.
  static std::string Said(const std::string& path) {
    StatusOr<ShiftReport> report = ReadShiftReport(path);
    EXPECT_THAT(report, IsOk());
    if (!report.ok()) return "";
    EXPECT_FALSE(report->evidence.empty());
    report->uuid.clear();
    report->vehicle.clear();
    report->run_hash.clear();
    // The chains of the two maps were moved to the begin of the shift in one step and in two.
    const auto round = [](double* value) { *value = std::round(*value * 1e6) / 1e6; };
    for (VisitEvidence& visit : report->evidence) {
      for (VisitEvidence::ModeLogLikelihood& mode : visit.modes) round(&mode.log_likelihood);
    }
    for (Decision& decision : report->decisions) round(&decision.log_odds);
    for (UnmappedSighting& sighting : report->sightings) {
      for (double& value : sighting.p_map_landmark) round(&value);
      for (double& value : sighting.cov_p_map_landmark.reshaped()) round(&value);
    }
    return EncodeShiftReport(*report);
  }

  // With the fleet's calibration: the map knows no truck 7.
  std::string SaidByRun() const {
    const std::string path = folder_.File("run.report");
    RunForJson("shiftmap-localizer",
               OnMap({"run", "--vehicle", "truck 7", "--report", path, world_->Log(2)}));
    return Said(path);
  }

  static std::int64_t Dropped(const live::ServiceState& state, const std::string& reason) {
    for (const DroppedCount& dropped : state.dropped) {
      if (dropped.reason == reason) return dropped.count;
    }
    return 0;
  }

  static inline World* world_ = nullptr;
  static inline std::vector<RunEvent>* items_ = nullptr;
  TempDir folder_;
  std::string socket_;
  std::string max_delay_s_ = "0";  // Nothing waits: what was taken is what was localized.
};

}  // namespace shiftmap::testing

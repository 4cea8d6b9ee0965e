// SPDX-License-Identifier: Apache-2.0
//
// The localizer as a service: a whole simulated shift over the socket, crashes, signals, and
// clients that do not behave. The oracle is `run` on the file.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <thread>

#include "localizer/live/unix_socket.h"
#include "tests/scenario/live_fixture.h"

namespace shiftmap::testing {
namespace {

TEST_F(LiveTest, ServedShiftIsAsGoodAsTheFile) {
  const auto service = Served();
  const auto ctl = [&](Arguments words) {
    words.insert(words.begin(), {"ctl", "--socket", socket_});
    return RunForJson("shiftmap-localizer", words);
  };
  EXPECT_EQ(ctl({"state"})["running"], false);
  EXPECT_EQ(ctl({"start", "--vehicle", "truck 7"})["running"], true);
  ctl({"feed", world_->Log(2)});
  const Json stopped = ctl({"stop"});
  EXPECT_EQ(stopped["running"], false);
  const std::string report = stopped["report"];
  EXPECT_TRUE(Said(report) == SaidByRun());
  EXPECT_EQ(ReadShiftReport(report)->vehicle, "truck 7");
  EXPECT_EQ(ReadShiftReport(report)->uuid, stopped["report_uuid"]);
  EXPECT_EQ(service->End(SIGTERM), kDone);
  EXPECT_FALSE(std::filesystem::exists(socket_));
}

TEST_F(LiveTest, WhoFeedsIsToldWhatIsNotTakenIn) {
  constexpr int kAttention = 8;
  const auto service = Served();
  const auto ctl = [&](Arguments words) {
    words.insert(words.begin(), {"ctl", "--socket", socket_});
    return RunCommand("shiftmap-localizer", words);
  };
  const CommandResult unstarted = ctl({"feed", world_->Log(2)});
  EXPECT_EQ(unstarted.exit_code, kAttention);
  EXPECT_NE(unstarted.err.find(fmt::format("{} items were not taken in: no_shift", items_->size())),
            std::string::npos)
      << unstarted.err;
  ASSERT_EQ(ctl({"start"}).exit_code, kDone);
  const CommandResult fed = ctl({"feed", world_->Log(2)});
  EXPECT_EQ(fed.exit_code, kDone) << fed.err;
  EXPECT_EQ(fed.err, "");
}

TEST_F(LiveTest, PipeGivesTheSameReportAsTheFile) {
  const std::string path = folder_.File("pipe.report");
  RunForJson("shiftmap-localizer",
             OnMap({"run", "--vehicle", "truck 7", "--report", path, "-"}),
             {.input = ReadFile(world_->Log(2))});
  EXPECT_TRUE(Said(path) == SaidByRun());
}

TEST_F(LiveTest, KilledTwiceItReportsAsIfNothingHadHappened) {
  const std::size_t third = items_->size() / 3;
  std::string uuid;
  std::string report;
  for (int life = 0; life < 3; ++life) {
    const auto service = Served();
    live::Client client = Connected();
    if (life == 0) uuid = Call(&client, live::Start()).report_uuid;
    const live::ServiceState state = Call(&client, live::GetState());
    EXPECT_TRUE(state.running);
    EXPECT_EQ(state.resumed, life > 0);
    EXPECT_EQ(state.report_uuid, uuid);
    const auto part = static_cast<std::size_t>(life);
    Feed(&client, part * third, life < 2 ? (part + 1) * third : items_->size());
    if (life == 2) report = Call(&client, live::Stop()).report_path;
    EXPECT_EQ(service->End(SIGKILL), 128 + SIGKILL);
  }
  EXPECT_TRUE(Said(report) == SaidByRun());
  EXPECT_EQ(ReadShiftReport(report)->uuid, uuid);

  const std::string store = folder_.File("maps.db");
  std::filesystem::copy_file(world_->File("maps.db"), store);
  RunForJson("shiftmap-localizer", {"return", "--store", store, report});
  EXPECT_EQ(RunCommand("shiftmap-localizer", {"return", "--store", store, report}).exit_code,
            kNothingToDo);
}

TEST_F(LiveTest, TermSavesPoseAndReportWithinASecond) {
  const std::size_t half = items_->size() / 2;
  OdometrySample standing;
  standing.stamp = StampOf(items_->at(half - 1));
  {
    const auto service = Served();
    live::Client client = Connected();
    Call(&client, live::Start());
    Feed(&client, 0, half);
    for (int i = 0; i < 20; ++i) {
      standing.stamp += std::chrono::milliseconds(50);
      ASSERT_THAT(client.Send({.id = 0, .command = standing}), IsOk());
    }
    const auto begin = Clock::now();
    EXPECT_EQ(service->End(SIGTERM), kDone);
    EXPECT_LT(Clock::now() - begin, std::chrono::seconds(1));
  }
  EXPECT_TRUE(std::filesystem::exists(socket_ + ".state/pose"));
  EXPECT_FALSE(std::filesystem::exists(socket_ + ".state/shift.journal"));
  const auto service = Served();
  live::Client client = Connected();
  EXPECT_FALSE(Call(&client, live::Start()).resumed);
  // It knows where it is from the first scan on.
  std::size_t next = half;
  while (StampOf(items_->at(next)) <= standing.stamp) ++next;
  std::size_t first_scan = next;
  while (!std::holds_alternative<Scan>(items_->at(first_scan))) ++first_scan;
  const live::ServiceState state = Feed(&client, next, first_scan + 1);
  EXPECT_EQ(state.scans, 1);
  EXPECT_NE(state.localizer_state, LocalizerState::kInitializing);
  EXPECT_TRUE(state.pose.has_value());
  EXPECT_FALSE(std::filesystem::exists(socket_ + ".state/pose"));
}

TEST_F(LiveTest, OneClientDownloadsMapsAndNobodyOwnsThemUnlessTheServiceSaysSo) {
  const std::string maps = folder_.File("maps");
  Arguments words = {"serve", "--socket", socket_, "--maps", maps, "--area", "floor"};
  const auto refused = [](live::Client* client, const live::Subscribe& subscribe) {
    return client->Call(subscribe).status().code() == StatusCode::kFailedPrecondition;
  };
  const live::Subscribe downloads{.map_downloads = true};
  const live::Subscribe owner{.map_owner = true};
  const live::EnableMap unknown{{"a", "floor", "1-0-0"}};
  {
    const auto service = Answering(words);
    live::Client first = Connected();
    Call(&first, downloads);
    live::Client second = Connected();
    EXPECT_TRUE(refused(&second, downloads));
    EXPECT_TRUE(refused(&second, owner));
    EXPECT_EQ(second.Call(unknown).status().code(), StatusCode::kNotFound);
    Call(&first, live::Subscribe());
    Call(&second, downloads);
  }
  words.insert(words.end(), {"--map-source", "server"});
  const auto service = Answering(words);
  live::Client client = Connected();
  EXPECT_EQ(client.Call(unknown).status().code(), StatusCode::kFailedPrecondition);
  Call(&client, owner);
  const live::EnableMap again{{"b", "floor", "1-0-0"}};
  EXPECT_EQ(client.Call(again).status().code(), StatusCode::kNotFound);
}

TEST_F(LiveTest, SubscriberGetsAPoseForEveryItem) {
  const auto service = Served({"--start"});
  live::Client listener = Connected();
  Call(&listener, live::Subscribe{.poses = true, .states = true, .decisions = true});
  live::Client feeder = Connected();
  constexpr std::size_t kItems = 1500;
  const live::ServiceState state = Feed(&feeder, 0, kItems);
  ASSERT_TRUE(state.pose);
  int odometry_poses = 0;
  std::int64_t decisions = 0;
  Stamp previous;
  while (previous < state.stamp) {
    const StatusOr<live::Event> event = listener.Receive();
    ASSERT_THAT(event, IsOk());
    if (std::holds_alternative<Decision>(*event)) ++decisions;
    const auto* pose = std::get_if<live::PoseEvent>(&*event);
    if (pose == nullptr) continue;
    EXPECT_GE(pose->stamp, previous);
    if (pose->stamp > previous) ++odometry_poses;
    previous = pose->stamp;
  }
  EXPECT_GT(odometry_poses, static_cast<int>(kItems / 2));
  EXPECT_GT(decisions, 0);
}

TEST_F(LiveTest, ServiceManagerIsTold) {
  const std::string path = folder_.File("notify");
  const OwnedFd manager(socket(AF_UNIX, SOCK_DGRAM, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.data(), path.size());
  ASSERT_EQ(bind(manager.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  const auto service = Served({}, {"NOTIFY_SOCKET=" + path, "WATCHDOG_USEC=200000"});
  std::string all;
  const auto listen = [&] {
    char bytes[256];
    ssize_t count = 0;
    while ((count = recv(manager.get(), bytes, sizeof(bytes), MSG_DONTWAIT)) > 0) {
      all.append(bytes, static_cast<std::size_t>(count)).append("\n");
    }
  };
  // The system holds a few datagrams only.
  for (int i = 0; i < 10; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    listen();
  }
  EXPECT_EQ(service->End(SIGTERM), kDone);
  listen();
  EXPECT_TRUE(all.starts_with("READY=1")) << all;
  const std::size_t stopping = all.find("STOPPING=1");
  EXPECT_NE(stopping, std::string::npos) << all;
  int signs = 0;
  for (std::size_t at = 0; (at = all.find("WATCHDOG=1", at)) < stopping; ++at) ++signs;
  EXPECT_GE(signs, 5) << all;
}

TEST_F(LiveTest, HostileClientsHarmNobody) {
  const auto service = Served({"--start"});
  live::Client good = Connected();
  const auto say = [&](const std::string& bytes) {
    StatusOr<OwnedFd> fd = live::ConnectTo(socket_);
    EXPECT_THAT(fd, IsOk());
    send(fd->get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    shutdown(fd->get(), SHUT_WR);
    char answer[512];
    while (recv(fd->get(), answer, sizeof(answer), 0) > 0) continue;
  };
  say("");
  say("\xff\xff\xff\xff\xff\xff\xff\xff\x7f");
  say(std::string("\x05hello", 6));
  say(live::Framed(std::string(1000, '\xff')));
  say(std::string("\x7f", 1));
  Feed(&good, 0, 200);
  OdometrySample bad = std::get<OdometrySample>(*std::find_if(
      items_->begin(), items_->end(), [](const RunEvent& item) { return item.index() == 0; }));
  EXPECT_THAT(good.Call(bad), StatusIs(StatusCode::kInvalidArgument, "time order"));
  bad.v_mps = std::nan("");
  EXPECT_THAT(good.Call(bad), StatusIs(StatusCode::kInvalidArgument, "finite"));
  bad.v_mps = 0.0;
  bad.stamp = std::chrono::system_clock::now() + std::chrono::hours(1);
  EXPECT_THAT(good.Call(bad), StatusIs(StatusCode::kInvalidArgument, "expected at most"));

  const live::ServiceState state = Call(&good, live::GetState());
  EXPECT_EQ(state.scans, std::count_if(items_->begin(), items_->begin() + 200, [](const auto& e) {
              return std::holds_alternative<Scan>(e);
            }));
  EXPECT_EQ(Dropped(state, "bad_frame"), 1);
  EXPECT_EQ(Dropped(state, "bad_request"), 3);
  EXPECT_EQ(Dropped(state, "late"), 1);
  EXPECT_EQ(Dropped(state, "future"), 1);
}

TEST_F(LiveTest, ClientThatNeverReadsLosesNewsOnly) {
  const auto service = Served({"--start"});
  live::Client slow = Connected();
  Call(&slow, live::Subscribe{.poses = true, .states = true, .decisions = true});
  live::Client feeder = Connected();
  Feed(&feeder, 0, items_->size());
  OdometrySample sample;
  sample.stamp = StampOf(items_->back());
  for (int i = 0; i < 10000; ++i) {
    sample.stamp += std::chrono::milliseconds(10);
    ASSERT_THAT(feeder.Send({.id = 0, .command = sample}), IsOk());
  }
  const live::ServiceState state = Call(&feeder, live::GetState());
  EXPECT_EQ(state.stamp, sample.stamp);
  EXPECT_GT(Dropped(state, "slow_client"), 1000);
}

TEST_F(LiveTest, WhatIsHeldDoesNotWaitForTheNextItem) {
  max_delay_s_ = "0.2";
  const auto service = Served({"--start"});
  live::Client client = Connected();
  const std::size_t fed = items_->size() / 2;
  live::ServiceState state = Feed(&client, 0, fed);
  const std::int64_t scans =
      std::count_if(items_->begin(),
                    items_->begin() + static_cast<std::ptrdiff_t>(fed),
                    [](const RunEvent& item) { return std::holds_alternative<Scan>(item); });
  const auto deadline = Clock::now() + std::chrono::seconds(20);
  while (state.scans < scans && Clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    state = Call(&client, live::GetState());
  }
  EXPECT_EQ(state.scans, scans);
}

TEST_F(LiveTest, SaysWhatItBelieves) {
  const auto service = Served({"--start"});
  live::Client client = Connected();
  Feed(&client, 0, items_->size());
  const Json hypotheses =
      RunForJson("shiftmap-localizer", {"ctl", "--socket", socket_, "hypotheses"});
  EXPECT_GE(hypotheses["leaves"].get<int>(), 1);
  EXPECT_NEAR(hypotheses["tree"]["probability"].get<double>() +
                  hypotheses["probability_left_out"].get<double>(),
              1.0,
              1e-6);
  ASSERT_FALSE(hypotheses["visits"].empty());
  for (const Json& visit : hypotheses["visits"]) {
    double sum = 0.0;
    for (const auto& probability : visit["probabilities"]) sum += probability.get<double>();
    EXPECT_NEAR(sum, 1.0, 1e-6);
  }
}

TEST_F(LiveTest, VerbsOutOfTurnAreRefused) {
  const auto service = Served();
  const auto refused = [&](int exit_code, const std::string& why, Arguments words) {
    words.insert(words.begin(), {"ctl", "--socket", socket_});
    ExpectError("shiftmap-localizer", words, exit_code, why);
  };
  refused(kBadInput, "no shift is under way", {"stop"});
  refused(kNotFound, "no hypotheses", {"hypotheses"});
  refused(kNotFound, "'cellar'", {"set-map", "cellar"});
  refused(kBadInput, "content hash", {"set-map", "floor", "--content-hash", "1234"});
  refused(kNotFound, "version 9", {"set-map", "floor", "--map-version", "9"});
  live::Client client = Connected();
  EXPECT_EQ(Call(&client, live::SetMap{"floor", VersionNumber(1), ""}).version, VersionNumber(1));
  EXPECT_THAT(client.Call(items_->front().index() == 0
                              ? live::Command(std::get<OdometrySample>(items_->front()))
                              : live::Command(std::get<Scan>(items_->front()))),
              StatusIs(StatusCode::kFailedPrecondition, "no shift"));
  Call(&client, live::Start());
  refused(kBadInput, "is under way", {"start"});
  refused(kBadInput, "between shifts", {"set-map", "floor"});
}

TEST_F(LiveTest, ServiceThatCannotBeIsRefused) {
  const auto refused = [&](int exit_code, const std::string& why, const Arguments& words) {
    ExpectError("shiftmap-localizer", words, exit_code, why);
  };
  refused(kNotFound,
          "'cellar'",
          {"serve", "--socket", socket_, "--store", world_->File("maps.db"), "--area", "cellar"});
  refused(
      kBadInput, "content hash", OnMap({"serve", "--socket", socket_, "--content-hash", "1234"}));
  refused(kBadInput, "bytes", OnMap({"serve", "--socket", folder_.File(std::string(120, 'x'))}));
  refused(kNotFound, "bind", OnMap({"serve", "--socket", folder_.File("no/folder")}));
  WriteFile(folder_.File("notes"), "keep");
  refused(kBadInput, "notes", OnMap({"serve", "--socket", folder_.File("notes")}));
  refused(kNotFound, socket_, {"ctl", "--socket", socket_, "state"});

  auto service = Served();
  refused(kTemporary, "in use", Serve());
  refused(kTemporary,
          "in use",
          OnMap({"serve", "--socket", folder_.File("other"), "--state-dir", socket_ + ".state"}));
  EXPECT_EQ(service->End(SIGKILL), 128 + SIGKILL);
  EXPECT_TRUE(std::filesystem::exists(socket_));
  service = Served();
  EXPECT_EQ(service->End(SIGTERM), kDone);
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
//
// What a vehicle exchanges with the map server, through the programs.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>

#include "localizer/live/client.h"
#include "localizer/maps/map_folder.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/map_store.h"
#include "mapstore/sqlite/database.h"
#include "tests/scenario/server_fixture.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

namespace fs = std::filesystem;

constexpr int kUsage = 2;
constexpr int kBadInput = 3;
constexpr int kNothingToDo = 5;
constexpr int kNotFound = 6;
constexpr int kAttention = 8;
constexpr int kTemporary = 75;
constexpr int kStopped = 130;

bool Soon(const std::function<bool()>& holds) {
  for (int i = 0; i < 400 * kSlowdown; ++i) {
    if (holds()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return false;
}

class TransferTest : public ServerTest {
 protected:
  TransferTest() : server_(Tls()) {}

  // A command of a vehicle with its certificate.
  Arguments As(const std::string& name, Arguments words) const {
    const std::string ca = certificates_->File("ca");
    for (const std::string& word : {std::string("--server"),
                                    server_.address(),
                                    std::string("--tls-ca"),
                                    ca + "/ca.pem",
                                    std::string("--tls-cert"),
                                    ca + "/" + name + ".pem",
                                    std::string("--tls-key"),
                                    ca + "/" + name + ".key",
                                    std::string("--give-up-s"),
                                    std::string("5")}) {
      words.push_back(word);
    }
    return words;
  }

  static int Code(const Arguments& words) {
    return RunCommand("shiftmap-localizer", words).exit_code;
  }

  std::size_t StoredReports() const {
    StatusOr<MapStore> store = MapStore::Open(store_, MapStore::Access::kReadOnly);
    EXPECT_THAT(store, IsOk());
    return store->Reports("floor")->size();
  }

  ServerProcess server_;
};

TEST(TransferProgram, NamesItself) {
  const std::string help = RunCommand("shiftmap-transfer", {"--help"}).out;
  EXPECT_NE(help.find("Usage: shiftmap-transfer "), std::string::npos) << help;
}

TEST_F(TransferTest, AVehicleFetchesItsMapAndHandsInWhatItLearned) {
  const std::string output = dir_.File("floor.db");
  const Json fetched = RunForJson("shiftmap-localizer",
                                  As(Vehicle(), {"fetch", "--area", "floor", "--output", output}));
  EXPECT_EQ(fetched["version"], 1);
  EXPECT_EQ(fetched["changed"], true);
  EXPECT_EQ(Code(As(Vehicle(), {"fetch", "--area", "floor", "--output", output})), kNothingToDo);
  ExpectError("shiftmap-localizer",
              As(Vehicle(), {"fetch", "--area", "yard", "--output", dir_.File("yard.db")}),
              kNotFound,
              "'yard'");
  // As a vehicle uses it.
  const std::string report = dir_.File("shift.report");
  RunForJson("shiftmap-localizer",
             {"run", "--snapshot", output, "--area", "floor", "--report", report, LogPath()});

  const Json returned = RunForJson("shiftmap-localizer", As(Vehicle(), {"return", report}));
  EXPECT_EQ(returned["reports"][0]["duplicate"], false);
  EXPECT_GT(returned["reports"][0]["evidence_rows"], 0);
  EXPECT_EQ(Code(As(Vehicle(), {"return", report})), kNothingToDo);
  EXPECT_EQ(StoredReports(), 1u);

  const Json uploaded = RunForJson("shiftmap-localizer", As(Vehicle(), {"upload", LogPath()}));
  EXPECT_EQ(uploaded["logs"][0]["size_bytes"], LogBytes().size());
  EXPECT_EQ(Code(As(Vehicle(), {"upload", LogPath()})), kNothingToDo);
}

TEST_F(TransferTest, AStoppedFetchGoesOnLater) {
  const std::string output = dir_.File("floor.db");
  const Arguments words = As(Vehicle(), {"fetch", "--area", "floor", "--output", output});
  Arguments slow = words;
  slow.insert(slow.end(), {"--max-kib-per-s", "1"});
  for (const int signal : {SIGINT, SIGTERM}) {
    BackgroundCommand fetch("shiftmap-localizer", slow);
    ASSERT_TRUE(Soon([&] { return fs::exists(output + ".part"); })) << fetch.Errors();
    fetch.WaitUntilItCatches(signal);
    EXPECT_EQ(fetch.End(signal), kStopped);
    EXPECT_NE(fetch.Errors().find(", the next one goes on from '" + output + ".part'\n"),
              std::string::npos)
        << fetch.Errors();
    EXPECT_EQ(CountLines(fetch.Errors()), 1) << fetch.Errors();
    EXPECT_FALSE(fs::exists(output));
  }
  EXPECT_EQ(RunForJson("shiftmap-localizer", words)["changed"], true);
  EXPECT_FALSE(fs::exists(output + ".part"));
}

TEST_F(TransferTest, AStoppedUploadGoesOnLater) {
  const Arguments words = As(Vehicle(), {"upload", LogPath()});
  Arguments slow = words;
  slow.insert(slow.end(), {"--max-kib-per-s", "1"});
  for (const int signal : {SIGINT, SIGTERM}) {
    BackgroundCommand upload("shiftmap-localizer", slow);
    upload.WaitUntilItCatches(signal);
    EXPECT_EQ(upload.End(signal), kStopped);
    EXPECT_NE(upload.Errors().find(", 0 of 1 files are done, the same command goes on\n"),
              std::string::npos)
        << upload.Errors();
    EXPECT_EQ(CountLines(upload.Errors()), 1) << upload.Errors();
  }
  RunForJson("shiftmap-localizer", words);
  EXPECT_EQ(Code(words), kNothingToDo);
}

TEST_F(TransferTest, AStoppedReturnSaysWhatIsDone) {
  const std::string report = world_->File("shift.report");
  const std::string second = dir_.File("second.report");
  ShiftReport another = *ReadShiftReport(report);
  another.uuid.back() = another.uuid.back() == '0' ? '1' : '0';
  ASSERT_THAT(WriteShiftReport(another, second), IsOk());
  const auto expect_stopped = [](BackgroundCommand& returned, int signal) {
    EXPECT_EQ(returned.End(signal), kStopped);
    EXPECT_NE(returned.Errors().find(" of 2 files are done, the same command goes on\n"),
              std::string::npos)
        << returned.Errors();
    EXPECT_EQ(CountLines(returned.Errors()), 1) << returned.Errors();
  };
  {
    // Nobody listens there.
    Arguments words = As(Vehicle(), {"return", report, second});
    *(std::find(words.begin(), words.end(), "--server") + 1) = "127.0.0.1:1";
    words.back() = "1000";  // --give-up-s
    BackgroundCommand returned("shiftmap-localizer", words);
    returned.WaitUntilItCatches(SIGTERM);
    expect_stopped(returned, SIGTERM);
  }
  const std::string copy = dir_.File("copy.db");
  fs::copy_file(world_->File("maps.db"), copy);
  const Arguments words = {"return", "--store", copy, report, second};
  StatusOr<Database> writer = Database::Open(copy, {.mode = Database::Mode::kReadWrite});
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->Execute("BEGIN IMMEDIATE"), IsOk());
  BackgroundCommand returned("shiftmap-localizer", words);
  returned.WaitUntilItCatches(SIGTERM);
  kill(returned.pid(), SIGTERM);
  ASSERT_THAT(writer->Execute("ROLLBACK"), IsOk());
  expect_stopped(returned, 0);
  RunForJson("shiftmap-localizer", words);
  EXPECT_EQ(Code(words), kNothingToDo);
}

TEST_F(TransferTest, AnotherVehiclesReportAndLogAreRefusedForGood) {
  const std::string report = world_->File("shift.report");
  const CommandResult returned =
      RunCommand("shiftmap-localizer", As("another", {"return", report, "--json"}));
  EXPECT_EQ(returned.exit_code, kBadInput) << returned.err;
  EXPECT_EQ(CountLines(returned.err), 1) << returned.err;
  EXPECT_TRUE(Json::parse(returned.out)["reports"][0].contains("error"));
  EXPECT_EQ(Code(As("another", {"upload", LogPath()})), kBadInput);
  EXPECT_EQ(StoredReports(), 0u);
}

// gRPC says of such files that it has no address, or that the socket is closed.
TEST_F(TransferTest, WhatIsWrongWithACertificateIsSaid) {
  const Arguments fetch = {"fetch", "--area", "floor", "--output", dir_.File("floor.db")};
  const std::string ca = certificates_->File("ca");
  const auto with_key = [&](const std::string& key) {
    Arguments words = As(Vehicle(), fetch);
    *(std::find(words.begin(), words.end(), "--tls-key") + 1) = key;
    return words;
  };
  ExpectError("shiftmap-localizer", with_key(ca + "/another.key"), kBadInput, "does not belong");
  ExpectError("shiftmap-localizer", with_key(ca + "/ca.pem"), kBadInput, "private key in PEM");
  MakeCertificate({"client", ca, "vehicle", "over"}, "ENDS=20200101000000Z");
  const std::string report = world_->File("shift.report");
  for (const Arguments& words :
       {fetch, Arguments{"return", report}, Arguments{"upload", LogPath()}}) {
    const CommandResult refused = RunCommand("shiftmap-localizer", As("over", words));
    EXPECT_EQ(refused.exit_code, kBadInput) << refused.err;
    EXPECT_EQ(CountLines(refused.err), 1) << refused.err;
    EXPECT_NE(refused.err.find("to 2020-01-01"), std::string::npos) << refused.err;
  }

  // And of the server's.
  const std::string other = dir_.File("other");
  MakeCertificate({"init", other});
  Arguments stranger = As(Vehicle(), fetch);
  *(std::find(stranger.begin(), stranger.end(), "--tls-ca") + 1) = other + "/ca.pem";
  ExpectError("shiftmap-localizer", stranger, kBadInput, "certificate verify failed");
}

TEST_F(TransferTest, WithoutAServerItIsTemporaryAndABadFileIsNotSent) {
  server_.End(SIGKILL);
  const std::string report = world_->File("shift.report");
  Arguments words = As(Vehicle(), {"return", report});
  words.back() = "0";  // --give-up-s
  EXPECT_EQ(Code(words), kTemporary);
  WriteFile(dir_.File("bad.report"), "no report");
  words = As(Vehicle(), {"return", report, dir_.File("bad.report")});
  ExpectError("shiftmap-localizer", words, kBadInput, dir_.File("bad.report"));
}

TEST_F(TransferTest, ReturnTakesExactlyOneOfStoreAndServer) {
  const std::string report = world_->File("shift.report");
  ExpectError("shiftmap-localizer", {"return", report}, kUsage, "either --store or --server");
  ExpectError("shiftmap-localizer",
              As(Vehicle(), {"return", "--store", store_, report}),
              kUsage,
              "excludes");
  // The one on the command line takes the place of the one in the site file.
  WriteFile(dir_.File("site.toml"), "server = 'maps.example.com:7443'\n");
  RunForJson("shiftmap-localizer",
             {"return", "--store", store_, report},
             {.environment = {"SHIFTMAP_CONFIG=" + dir_.File("site.toml")}});
}

TEST_F(TransferTest, TheSiteFileSaysWhereTheServerIs) {
  const std::string ca = certificates_->File("ca");
  WriteFile(dir_.File("site.toml"),
            "server = '" + server_.address() + "'\narea = 'floor'\ntls-ca = '" + ca +
                "/ca.pem'\n[localizer]\ntls-cert = '" + ca + "/" + Vehicle() +
                ".pem'\ntls-key = '" + ca + "/" + Vehicle() +
                ".key'\n[localizer.run]\nalpha = 1e-6\n[localizer.fetch]\ngive-up-s = 5\n");
  const CommandOptions options{.environment = {"SHIFTMAP_CONFIG=" + dir_.File("site.toml")}};
  RunForJson("shiftmap-localizer", {"fetch", "--output", dir_.File("floor.db")}, options);
}

TEST_F(TransferTest, TheLocalizerItselfLinksNeitherGrpcNorCeres) {
  FILE* const pipe = popen("ldd " SHIFTMAP_LOCALIZER, "r");
  std::string libraries;
  std::array<char, 4096> piece = {};
  for (std::size_t got = 0; (got = fread(piece.data(), 1, piece.size(), pipe)) > 0;) {
    libraries.append(piece.data(), got);
  }
  pclose(pipe);
  EXPECT_NE(libraries.find("libsqlite3"), std::string::npos) << libraries;
  for (const char* name : {"grpc", "ceres", "curl"}) {
    EXPECT_EQ(libraries.find(name), std::string::npos) << libraries;
  }
}

// The vehicle's own service beside the daemon that exchanges with the server.
TEST_F(TransferTest, SyncHandsInWhatServeLeavesAndBringsMapsBetweenShifts) {
  const std::string socket = dir_.File("s");
  const std::string state = dir_.File("state");
  const std::string maps = dir_.File("maps");
  fs::create_directory(state);
  BackgroundCommand sync("shiftmap-localizer",
                         As(Vehicle(),
                            {"sync",
                             "--state-dir",
                             state,
                             "--outbox",
                             dir_.File("outbox"),
                             "--map-source",
                             "server",
                             "--area",
                             "floor",
                             "--maps",
                             maps,
                             "--socket",
                             socket,
                             "--poll-s",
                             "0.1"}));
  const auto enabled_version = [&]() -> std::string {
    StatusOr<MapFolder> folder = MapFolder::Open(maps);
    if (!folder.ok()) return "";
    const auto map = folder->Enabled("floor");
    return map.ok() && *map ? (*map)->map_version : "";
  };
  // Without a service there is no shift: the first map is enabled at once.
  ASSERT_TRUE(Soon([&] { return enabled_version().starts_with("1-"); })) << sync.Errors();
  const BackgroundCommand serve("shiftmap-localizer",
                                {"serve",
                                 "--maps",
                                 maps,
                                 "--area",
                                 "floor",
                                 "--map-source",
                                 "server",
                                 "--vehicle",
                                 Vehicle(),
                                 "--socket",
                                 socket,
                                 "--state-dir",
                                 state});
  ASSERT_TRUE(Soon([&] { return live::Client::Connect(socket).ok(); })) << serve.Errors();
  StatusOr<live::Client> client = live::Client::Connect(socket);
  ASSERT_THAT(client->Call(live::Start()), IsOk());
  const StatusOr<RunLog> log = ReadRunLog(LogPath());
  ASSERT_THAT(log, IsOk());
  const std::vector<RunEvent> items = MergeEvents(log->run);
  const auto feed = [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto command =
          std::visit([](const auto& item) { return live::Command(item); }, items[i]);
      ASSERT_THAT(client->Send({.id = 0, .command = command}), IsOk());
    }
  };
  feed(0, items.size() / 2);
  // A version is published while the vehicle drives.
  RunForJson("shiftmap-inspect",
             {"edit",
              "rename",
              "L01",
              "gate",
              "--reason",
              "new label",
              "--store",
              store_,
              "--area",
              "floor"});
  ASSERT_TRUE(Soon([&] {
    StatusOr<MapFolder> folder = MapFolder::Open(maps);
    return folder.ok() && folder->List()->size() == 2;
  })) << sync.Errors();
  feed(items.size() / 2, items.size());
  const StatusOr<live::Reply> driving = client->Call(live::GetState());
  ASSERT_THAT(driving, IsOk());
  EXPECT_EQ(driving->state->version, VersionNumber(1));
  EXPECT_TRUE(enabled_version().starts_with("1-"));

  const StatusOr<live::Reply> stopped = client->Call(live::Stop());
  ASSERT_THAT(stopped, IsOk());
  EXPECT_TRUE(Soon([&] { return enabled_version().starts_with("2-"); })) << sync.Errors();
  const std::string uuid = stopped->state->report_uuid;
  EXPECT_TRUE(Soon([&] { return StoredReports() == 1; })) << sync.Errors();
  const std::string uploaded = logs_ + "/" + Vehicle() + "/" + uuid + ".mcap";
  EXPECT_TRUE(Soon([&] { return fs::exists(uploaded); })) << sync.Errors();
  EXPECT_TRUE(Soon([&] {
    return !fs::exists(state + "/" + uuid + ".report") && !fs::exists(state + "/" + uuid + ".mcap");
  })) << sync.Errors();
  const StatusOr<live::Reply> next = client->Call(live::GetState());
  ASSERT_THAT(next, IsOk());
  EXPECT_EQ(next->state->version, VersionNumber(2));
  EXPECT_EQ(sync.End(SIGTERM), 0);
}

TEST_F(TransferTest, SyncOnceSaysWhatIsLeft) {
  const std::string state = dir_.File("state");
  fs::create_directory(state);
  const Arguments once =
      As("another", {"sync", "--once", "--state-dir", state, "--outbox", dir_.File("outbox")});
  EXPECT_EQ(Code(once), kNothingToDo);
  fs::copy_file(world_->File("shift.report"), state + "/" + RandomUuid() + ".report");
  Arguments words = once;
  words.push_back("--json");
  const CommandResult refused = RunCommand("shiftmap-localizer", words);
  EXPECT_EQ(refused.exit_code, kAttention) << refused.err;
  const Json document = Json::parse(refused.out);
  EXPECT_EQ(document["refused"], 1);
  EXPECT_NE(document["refusals"][0]["reason"].get<std::string>().find("another"),
            std::string::npos);
  // Until somebody does something about it.
  EXPECT_EQ(Code(once), kAttention);
  fs::remove_all(state);
  fs::create_directory(state);
  EXPECT_EQ(Code(once), kNothingToDo);
}

}  // namespace
}  // namespace shiftmap::testing

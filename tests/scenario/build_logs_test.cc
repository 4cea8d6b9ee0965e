// SPDX-License-Identifier: Apache-2.0
//
// A log that is made to harm, comes from a clock that was wrong, or holds what no device measures,
// among good ones: it is named and left out, or its items are, and the others are built.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <set>

#include "mapstore/codec/run_log.h"
#include "mapstore/codec/run_log_messages.h"
#include "mapstore/core/clock.h"
#include "mapstore/map/sha256.h"
#include "proto/mcap/byte_writer.h"
#include "proto/mcap/compression.h"
#include "proto/mcap/crc32.h"
#include "proto/mcap/format.h"
#include "tests/scenario/background_command.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

using std::chrono::hours;
using std::chrono::seconds;

constexpr int kBadInput = 3;
constexpr int kAttention = 8;
constexpr int kNothingToDo = 5;
constexpr auto kYear = hours(24 * 365);
constexpr std::size_t kMib = std::size_t{1} << 20;

// The bytes of a log with the same message, `count` times, in chunks that are the same but for the
// last, and as large as a reader takes.
std::string Repeated(const RunLogTopic& topic, const std::string& data, std::size_t count) {
  using mcap::ByteWriter;
  using mcap::Opcode;
  constexpr std::uint16_t kId = 1;
  ByteWriter header;
  header.String("").String("test");
  ByteWriter schema;
  schema.Write(kId).String(topic.schema_name).String("protobuf").String(RunLogSchema());
  ByteWriter channel;
  channel.Write(kId).Write(kId).String(topic.topic).String("protobuf").String("");
  ByteWriter file;
  file.Bytes(mcap::kMagic)
      .Record(Opcode::kHeader, header.bytes())
      .Record(Opcode::kSchema, schema.bytes())
      .Record(Opcode::kChannel, channel.bytes());
  ByteWriter content;
  content.Write(kId).Write(std::uint32_t{0}).Write(std::uint64_t{0}).Write(std::uint64_t{0});
  ByteWriter message;
  message.Record(Opcode::kMessage, content.Bytes(data).bytes());
  const std::size_t per_chunk = mcap::kMaxChunkBytes / message.size();
  for (; count > 0; count -= std::min(count, per_chunk)) {
    std::string records;
    for (std::size_t i = 0; i < std::min(count, per_chunk); ++i) records += message.bytes();
    const std::string stored = *mcap::Compress(mcap::Compression::kZstd, records);
    ByteWriter chunk;
    chunk.Write(std::uint64_t{0}).Write(std::uint64_t{0}).Write(std::uint64_t{records.size()});
    chunk.Write(mcap::Crc32::Of(records)).String("zstd");
    chunk.Write(std::uint64_t{stored.size()}).Bytes(stored);
    file.Record(Opcode::kChunk, chunk.bytes());
  }
  return file.bytes();
}

void Shift(Duration by, shiftmap::Run* run) {
  for (OdometrySample& sample : run->odometry) sample.stamp += by;
  for (Scan& scan : run->scans) scan.stamp += by;
}

class BuildLogs : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new World({"--shifts", "3", "--duration-s", "60", "--groups", "10", "--size-m", "20"});
  }
  static void TearDownTestSuite() {
    delete world_;
    world_ = nullptr;
  }

  static shiftmap::Run ReadShift(int shift) {
    StatusOr<RunLog> log = ReadRunLog(world_->Log(shift));
    EXPECT_TRUE(log.ok()) << Message(log.status());
    return log.ok() ? std::move(log->run) : shiftmap::Run();
  }

  std::string Log(const std::string& name, const shiftmap::Run& run) const {
    const std::string path = folder_.File(name);
    const Status written = WriteRunLog(run, path);
    EXPECT_TRUE(written.ok()) << Message(written);
    return path;
  }

  Arguments Build(const Arguments& rest) const {
    Arguments words = {"build", "--store", folder_.File("maps.db"), "--area", "floor"};
    words.insert(words.end(), rest.begin(), rest.end());
    return words;
  }

  // Among two good logs it is left out by name for this reason, soon and in bounded memory; alone
  // it is what is wrong.
  void ExpectLeftOut(const std::string& bad, const std::string& reason) const {
    const auto begin = std::chrono::steady_clock::now();
    BackgroundCommand build("shiftmap-mapper",
                            Build({"--prior",
                                   "none",
                                   "--json",
                                   "--max-memory-mib",
                                   "500",
                                   world_->Log(0),
                                   bad,
                                   world_->Log(1)}));
    ASSERT_EQ(build.End(0), 0) << build.Errors();
    EXPECT_LT(std::chrono::steady_clock::now() - begin, seconds(30 * kSlowdown));
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    EXPECT_LT(build.PeakMib(), 500.0);
#endif
    const std::string errors = build.Errors();
    EXPECT_EQ(CountLines(errors), 1) << errors;
    EXPECT_NE(errors.find("is left out: run log '" + bad + "': "), std::string::npos) << errors;
    EXPECT_NE(errors.find(reason), std::string::npos) << errors;
    const Json document = Json::parse(build.Output());
    EXPECT_TRUE(document.contains("version"));
    EXPECT_EQ(document["runs"].size(), 2u);
    EXPECT_EQ(document["rejected"].size(), 1u);
    ExpectError("shiftmap-mapper",
                Build({"--prior", "none", "--max-memory-mib", "500", bad}),
                kBadInput,
                "run log '" + bad + "': ");
  }

  void ExpectLeftOut(const std::string& name,
                     const std::string& bytes,
                     const std::string& reason) const {
    const std::string path = folder_.File(name);
    WriteFile(path, bytes);
    ExpectLeftOut(path, reason);
  }

  static World* world_;
  TempDir folder_;
};

World* BuildLogs::world_ = nullptr;

TEST_F(BuildLogs, MillionsOfSamplesInAFewBytes) {
  const std::string sample = EncodeOdometry({StampFromNanoseconds(0), 0.0, 0.0});
  const std::string bytes = Repeated(kOdometryTopic, sample, 6'500'000);
  EXPECT_LT(bytes.size(), kMib);
  ExpectLeftOut("samples.mcap", bytes, "the chunks up to here hold");
}

TEST_F(BuildLogs, MoreSamplesThanTheBoundOnMemory) {
  const std::string sample = EncodeOdometry({StampFromNanoseconds(0), 0.0, 0.0});
  const std::string path = folder_.File("many.mcap");
  WriteFile(path, Repeated(kOdometryTopic, sample, 2'000'000));
  ExpectError("shiftmap-mapper",
              Build({"--max-memory-mib", "100", path}),
              kBadInput,
              "takes more than 50 MiB");
}

TEST_F(BuildLogs, AScanOfAMillionObservations) {
  std::string scan;
  while (scan.size() < 16 * kMib) scan.append("\x12\x02\x1a\x00", 4);
  const std::string bytes = Repeated(kLandmarksTopic, scan, 1);
  EXPECT_LT(bytes.size(), 20'000u);
  ExpectLeftOut("scan.mcap", bytes, "bytes, expected at most 1048576");
}

TEST_F(BuildLogs, NothingButRecordsToSkip) {
  const std::string bytes = Repeated({"/camera", "foxglove.CompressedImage"}, "", 6'500'000);
  EXPECT_LT(bytes.size(), kMib);
  ExpectLeftOut("skipped.mcap", bytes, "the chunks up to here hold");
}

TEST_F(BuildLogs, MoreLandmarksThanTheBoundOnMemory) {
  shiftmap::Run run;
  for (int i = 0; i < 40; ++i) {
    const Stamp stamp = StampFromSeconds(1e9 + i);
    run.odometry.push_back({stamp, 1.0, 0.0});
    Scan scan{stamp, {}};
    for (int k = 0; k < 3000; ++k) {
      Observation observation;
      observation.signature = Signature(std::to_string(k));
      observation.z = {1.0 + k % 7, 0.001 * k};
      scan.observations.push_back(observation);
    }
    run.scans.push_back(std::move(scan));
  }
  ExpectLeftOut(Log("landmarks.mcap", run), "allowed are 500 with all runs");
}

TEST_F(BuildLogs, TheOrderOfLogsDoesNotDecideWhichAreLeftOut) {
  shiftmap::Run long_run = ReadShift(2);
  const shiftmap::Run again = long_run;
  for (int i = 1; i < 40; ++i) {
    shiftmap::Run more = again;
    Shift(i * (again.odometry.back().stamp - again.odometry.front().stamp + seconds(1)), &more);
    long_run.odometry.insert(long_run.odometry.end(), more.odometry.begin(), more.odometry.end());
    long_run.scans.insert(long_run.scans.end(), more.scans.begin(), more.scans.end());
  }
  Arguments logs = {Log("long.mcap", long_run), world_->Log(0), world_->Log(1)};
  std::sort(logs.begin(), logs.end());
  std::set<std::string> outcomes;
  do {
    Arguments words = {"--dry-run", "--json", "--max-memory-mib", "30"};
    words.insert(words.end(), logs.begin(), logs.end());
    const CommandResult built = RunCommand("shiftmap-mapper", Build(words));
    ASSERT_EQ(built.exit_code, 0) << built.err;
    const Json document = Json::parse(built.out);
    EXPECT_EQ(document["runs"].size(), 2u);
    outcomes.insert(built.err + document["content_hash"].dump() + document["rejected"].dump());
  } while (std::next_permutation(logs.begin(), logs.end()));
  EXPECT_EQ(outcomes.size(), 1u) << *outcomes.begin() << *outcomes.rbegin();
  EXPECT_NE(outcomes.begin()->find("run 'long' is left out"), std::string::npos);
}

TEST_F(BuildLogs, ALogFromTheFuture) {
  shiftmap::Run run = ReadShift(2);
  Shift(SystemNow() + hours(24) - run.odometry.front().stamp, &run);
  const std::string ahead = Log("ahead.mcap", run);
  ExpectLeftOut(ahead, "s ahead, expected at most 600");
  EXPECT_EQ(RunCommand("shiftmap-mapper",
                       Build({"--prior", "none", "--clock-tolerance-s", "100000", ahead}))
                .exit_code,
            kAttention);  // It lacks the runs of the published map.
}

// A receiver that rolls over, or a clock that loses its battery.
TEST_F(BuildLogs, ALogWhoseLastSecondsJumpTenYears) {
  shiftmap::Run run = ReadShift(2);
  const Stamp from = run.odometry.back().stamp - seconds(10);
  const Duration jump = SystemNow() + 10 * kYear - from;
  for (OdometrySample& sample : run.odometry) {
    if (sample.stamp >= from) sample.stamp += jump;
  }
  for (Scan& scan : run.scans) {
    if (scan.stamp >= from) scan.stamp += jump;
  }
  ExpectLeftOut(Log("jump.mcap", run), "s ahead, expected at most 600");
}

TEST_F(BuildLogs, ALogWithoutAClockIsNamedAndUsed) {
  shiftmap::Run run = ReadShift(2);
  Shift(Stamp() - run.odometry.front().stamp, &run);
  const CommandResult built =
      RunCommand("shiftmap-mapper", Build({"--json", world_->Log(0), Log("unset.mcap", run)}));
  ASSERT_EQ(built.exit_code, 0) << built.err;
  EXPECT_EQ(CountLines(built.err), 1) << built.err;
  EXPECT_NE(built.err.find("begins at 1970-01-01 00:00:00 UTC"), std::string::npos) << built.err;
  EXPECT_EQ(Json::parse(built.out)["runs"].size(), 2u);
}

// A log without a UUID is known by what it holds.
TEST_F(BuildLogs, ACopyThatWasCutOffCountsOnce) {
  shiftmap::Run cut = ReadShift(2);
  cut.odometry.resize(cut.odometry.size() / 2);
  std::erase_if(cut.scans,
                [&](const Scan& scan) { return scan.stamp > cut.odometry.back().stamp; });
  const std::string part = Log("part.mcap", cut);
  const std::string whole = world_->Log(2);
  const CommandResult built = RunCommand("shiftmap-mapper", Build({"--json", part, whole}));
  ASSERT_EQ(built.exit_code, 0) << built.err;
  EXPECT_NE(built.err.find("run 'part' is left out: run log '" + part + "': a copy of the run"),
            std::string::npos)
      << built.err;
  EXPECT_EQ(Json::parse(built.out)["runs"].size(), 1u);
  ExpectError("shiftmap-mapper", Build({part}), kNothingToDo, "already in the map");

  EXPECT_EQ(RunCommand("shiftmap-mapper", Build({"--prior", "none", part})).exit_code, kAttention);
  ExpectError("shiftmap-mapper", Build({whole}), kNothingToDo, "built from a shorter copy of it");
}

// No copies of one another, whichever came first and has more: neither is taken for mapped.
TEST_F(BuildLogs, LogsOfTwoTimesWithOneUuidAreNamed) {
  shiftmap::Run first = ReadShift(0);
  shiftmap::Run second = ReadShift(1);
  second.info.uuid = first.info.uuid = "00000000-0000-4000-8000-000000000001";
  second.info.vehicle = first.info.vehicle;
  second.scans.resize(second.scans.size() / 2);
  const std::vector<std::string> logs = {Log("first.mcap", first), Log("second.mcap", second)};
  for (const std::size_t mapped : {0, 1}) {
    ASSERT_NE(RunCommand("shiftmap-mapper", Build({"--prior", "none", logs[mapped]})).exit_code, 3);
    ExpectError("shiftmap-mapper",
                Build({logs[1 - mapped]}),
                kNothingToDo,
                "has another run of its run UUID, from ");
  }
  const CommandResult built =
      RunCommand("shiftmap-mapper", Build({"--dry-run", "--prior", "none", logs[0], logs[1]}));
  EXPECT_NE(
      built.err.find("second.mcap': has the run UUID, but not the time, of run log '" + logs[0]),
      std::string::npos)
      << built.err;
}

// Two vehicles with one image of a disk may draw one UUID, at one time too.
TEST_F(BuildLogs, LogsOfTwoVehiclesWithOneUuidAreNamed) {
  shiftmap::Run first = ReadShift(0);
  first.info.uuid = "00000000-0000-4000-8000-000000000001";
  shiftmap::Run second = first;
  second.info.vehicle = first.info.vehicle + "-duplicate";
  second.scans.resize(second.scans.size() / 2);
  const std::vector<std::string> logs = {Log("first.mcap", first), Log("second.mcap", second)};
  const CommandResult built =
      RunCommand("shiftmap-mapper", Build({"--dry-run", "--prior", "none", logs[0], logs[1]}));
  EXPECT_NE(
      built.err.find("second.mcap': has the run UUID, but not the vehicle, of run log '" + logs[0]),
      std::string::npos)
      << built.err;
  ASSERT_NE(RunCommand("shiftmap-mapper", Build({"--prior", "none", logs[0]})).exit_code, 3);
  ExpectError("shiftmap-mapper",
              Build({logs[1]}),
              kNothingToDo,
              "has a run of vehicle '" + first.info.vehicle + "' with its run UUID");
}

// Without a clock all begin at one time.
TEST_F(BuildLogs, AClockThatWasNeverSetIsNamed) {
  for (const int year : {1970, 1980, 1999, 2001}) {
    shiftmap::Run run = ReadShift(0);
    const Stamp begin = std::chrono::sys_days(std::chrono::year(year) / 1 / 6);
    Shift(begin - run.odometry.front().stamp, &run);
    const CommandResult built =
        RunCommand("shiftmap-mapper", Build({"--dry-run", Log(fmt::format("{}.mcap", year), run)}));
    EXPECT_EQ(built.exit_code, 0) << built.err;
    EXPECT_EQ(built.err.find("clock was not set") != std::string::npos, year < 2000) << built.err;
  }
}

TEST_F(BuildLogs, AVehicleAtTwoPlacesAtOneTimeIsNamed) {
  const auto log = [&](const std::string& name, const std::string& vehicle, Duration later) {
    shiftmap::Run run = ReadShift(name == "a" ? 0 : 1);
    run.info.vehicle = vehicle;
    Shift(ReadShift(0).odometry.front().stamp - run.odometry.front().stamp + later, &run);
    return Log(name + ".mcap", run);
  };
  // What a build says of vehicles at two places. The run may wait besides.
  const auto expect = [&](const Arguments& logs, const std::string& line) {
    Arguments words = {"--json"};
    words.insert(words.end(), logs.begin(), logs.end());
    const CommandResult built = RunCommand("shiftmap-mapper", Build(words));
    ASSERT_FALSE(built.out.empty()) << built.err;
    const Json lines = Json::parse(built.out)["at_two_places"];
    EXPECT_EQ(lines, line.empty() ? Json::array() : Json::array({line}));
    EXPECT_EQ(built.err.find("vehicle 'robot'") != std::string::npos, !line.empty()) << built.err;
    EXPECT_NE(built.err.find(line), std::string::npos) << built.err;
  };
  const std::string a = log("a", "robot", seconds(0));
  expect({"--dry-run", a, log("other", "truck", seconds(30))}, "");
  expect({"--dry-run", a, log("later", "robot", seconds(61))}, "");
  const std::string b = log("b", "robot", seconds(30));
  const auto line = [](const std::string& first, const std::string& second) {
    return "vehicle 'robot' is in runs '" + first + "' and '" + second +
           "' at 2026-01-05 08:00:30 UTC: a clock is wrong, or two vehicles have one name";
  };
  const bool by_hash = *HashFile(a) < *HashFile(b);
  expect({"--dry-run", a, b}, by_hash ? line("a", "b") : line("b", "a"));
  expect({a}, "");
  // With what the map has.
  expect({b}, line("b", "a"));
}

TEST_F(BuildLogs, LogsWithoutAClockAreNoCopies) {
  for (const int shift : {0, 1}) {
    shiftmap::Run run = ReadShift(shift);
    run.info.vehicle = "robot";
    Shift(Stamp() - run.odometry.front().stamp, &run);
    RunForJson("shiftmap-mapper", Build({Log(fmt::format("unset-{}.mcap", shift), run)}));
  }
}

TEST_F(BuildLogs, ObservationsWithoutASignatureAreCounted) {
  shiftmap::Run run = ReadShift(0);
  std::set<Signature> all;
  for (const Scan& scan : run.scans) {
    for (const Observation& seen : scan.observations) all.insert(seen.signature);
  }
  const Signature middle = *std::next(all.begin(), static_cast<std::ptrdiff_t>(all.size() / 2));
  int anonymous = 0;
  for (Scan& scan : run.scans) {
    for (Observation& seen : scan.observations) {
      if (seen.signature <= middle) continue;
      seen.signature = Signature();
      ++anonymous;
    }
  }
  ASSERT_GT(anonymous, 100);
  const std::string log = Log("anonymous.mcap", run);
  const Arguments build = {"build", "--area", "floor", log, "--store"};
  const auto with = [&](const Arguments& more) {
    Arguments words = build;
    words.insert(words.end(), more.begin(), more.end());
    return RunCommand("shiftmap-mapper", words);
  };
  const CommandResult ignored = with({folder_.File("ignored.db"), "--json"});
  EXPECT_EQ(ignored.exit_code, 0);
  EXPECT_NE(ignored.err.find(fmt::format("{} observations without a signature", anonymous)),
            std::string::npos)
      << ignored.err;
  EXPECT_EQ(Json::parse(ignored.out)["runs"][0]["anonymous_observations"], anonymous);
  // The numbers agree with each other: as many are new as there are.
  const CommandResult text = with({folder_.File("text.db"), "--anonymous", "associate"});
  const Json same =
      Json::parse(with({folder_.File("json.db"), "--anonymous", "associate", "--json"}).out);
  const int places = same["anonymous_landmarks"];
  ASSERT_GT(places, 0);
  EXPECT_NE(text.out.find(fmt::format("{} modes and {} places without a signature, {} of them new",
                                      same["modes"].get<int>(),
                                      places,
                                      same["modes"].get<int>() + places)),
            std::string::npos)
      << text.out;
}

// What a driver writes for `no reading` is as if it were not there.
TEST_F(BuildLogs, ItemsBeyondTheLimitsAreDroppedAndCounted) {
  const Json good = RunForJson("shiftmap-mapper", Build({"--dry-run", world_->Log(0)}));
  shiftmap::Run run = ReadShift(0);
  run.odometry.insert(run.odometry.begin() + 50, {run.odometry[50].stamp, 1e8, -1e8});
  for (std::size_t i = 0; i < 5; ++i) {
    Observation error;
    error.signature = Signature("ERROR");
    error.z = {1e9, 0.1};
    run.scans[10 * i].observations.push_back(error);
  }
  const CommandResult built =
      RunCommand("shiftmap-mapper", Build({"--dry-run", "--json", Log("errors.mcap", run)}));
  ASSERT_EQ(built.exit_code, 0) << built.err;
  EXPECT_EQ(CountLines(built.err), 1) << built.err;
  EXPECT_NE(built.err.find("1 odometry samples and 5 observations"), std::string::npos)
      << built.err;
  const Json document = Json::parse(built.out);
  EXPECT_EQ(document["content_hash"], good["content_hash"]);
  EXPECT_EQ(document["runs"][0]["implausible_odometry"], 1);
  EXPECT_EQ(document["runs"][0]["implausible_observations"], 5);
  ExpectError("shiftmap-mapper",
              Build({"--max-speed-mps", "0.001", "--max-yaw-rate-radps", "0.001", world_->Log(0)}),
              kBadInput,
              "no odometry within the limits");

  // Nor does the localizer move for it.
  const std::string errors = folder_.File("errors.mcap");
  RunForJson("shiftmap-mapper", Build({world_->Log(0)}));
  const auto localize = [&](const std::string& log) {
    const CommandResult localized = RunCommand("shiftmap-localizer",
                                               {"run",
                                                "--store",
                                                folder_.File("maps.db"),
                                                "--area",
                                                "floor",
                                                "--trajectory",
                                                folder_.File("run.tum"),
                                                log});
    EXPECT_EQ(localized.exit_code, 0) << localized.err;
    EXPECT_EQ(CountLines(localized.err), log == errors ? 1 : 0) << localized.err;
    return ReadFile(folder_.File("run.tum"));
  };
  EXPECT_EQ(localize(errors), localize(world_->Log(0)));
}

}  // namespace
}  // namespace shiftmap::testing

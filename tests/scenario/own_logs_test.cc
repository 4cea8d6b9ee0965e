// SPDX-License-Identifier: Apache-2.0
//
// A user's own tables become a run log, and a check tells what is wrong with a log.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "mapstore/codec/run_log.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

const World& Shift() {
  static const World world(
      {"--shifts", "1", "--seed", "3", "--duration-s", "40", "--size-m", "20"});
  return world;
}

std::string Seconds(Stamp stamp) {
  const std::int64_t stamp_ns = ToNanoseconds(stamp);
  return fmt::format("{}.{:09}", stamp_ns / 1'000'000'000, stamp_ns % 1'000'000'000);
}

// Numbers that survive the way through text.
void WriteTables(const Run& run, const std::string& odometry, const std::string& observations) {
  std::ofstream samples(odometry);
  samples << "stamp_s,v_mps,omega_radps,temperature\n";
  for (const OdometrySample& sample : run.odometry) {
    samples << fmt::format(
        "{},{:.17g},{:.17g},20\n", Seconds(sample.stamp), sample.v_mps, sample.omega_radps);
  }
  std::ofstream scans(observations);
  scans << "stamp_s,signature,range_m,bearing_rad\n";
  for (const Scan& scan : run.scans) {
    if (scan.observations.empty()) scans << Seconds(scan.stamp) << ",,,\n";
    for (const Observation& seen : scan.observations) {
      scans << fmt::format("{},{},{:.17g},{:.17g}\n",
                           Seconds(scan.stamp),
                           seen.signature.text(),
                           seen.z.x(),
                           seen.z.y());
    }
  }
}

TEST(OwnLogs, TablesOfARunGiveTheRunBitByBit) {
  const RunLog original = ReadRunLog(Shift().Log(0)).value();
  const std::string odometry = Shift().File("odometry.csv");
  const std::string observations = Shift().File("observations.csv");
  WriteTables(original.run, odometry, observations);
  const std::string output = Shift().File("from_tables.mcap");
  const Arguments convert = {"csv",
                             "--odometry",
                             odometry,
                             "--observations",
                             observations,
                             "--output",
                             output,
                             "--vehicle",
                             original.run.info.vehicle,
                             "--area",
                             "hall"};
  const CommandResult result = RunCommand("shiftmap-convert", convert);
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_THAT(result.err, HasSubstr("odometry.csv: column 'temperature' is not used"));
  shiftmap::Run expected = original.run;
  expected.info.source = "csv";
  expected.info.area = "hall";
  const std::string same = Shift().File("expected.mcap");
  ASSERT_TRUE(WriteRunLog(expected, same).ok());
  EXPECT_EQ(ReadFile(output), ReadFile(same));
}

TEST(OwnLogs, AGoodLogIsClean) {
  const Json check = RunForJson("shiftmap-convert", {"check", Shift().Log(0)});
  for (const Json& finding : check["findings"]) EXPECT_EQ(finding["severity"], "note") << finding;
  EXPECT_NEAR(check["duration_s"].get<double>(), 40.0, 0.1);
  EXPECT_NEAR(check["odometry"]["rate_hz"].get<double>(), 20.0, 0.1);
  EXPECT_EQ(check["vehicle"], "vehicle-1");
  EXPECT_GT(check["signatures"], 5);
}

TEST(OwnLogs, AMistakeIsToldWithItsNameAndExitCodeEight) {
  shiftmap::Run run = ReadRunLog(Shift().Log(0))->run;
  for (Scan& scan : run.scans) {
    for (Observation& seen : scan.observations) seen.z.y() = -seen.z.y();
  }
  // The log's names are anybody's.
  run.info.vehicle = "\x1b[2J<script>\nnothing is wrong";
  const std::string log = Shift().File("mirrored.mcap");
  ASSERT_TRUE(WriteRunLog(run, log).ok());
  const CommandResult text = RunCommand("shiftmap-convert", {"check", log});
  EXPECT_EQ(text.exit_code, 8);
  EXPECT_THAT(text.out, HasSubstr("warning: bearing_sign"));
  EXPECT_THAT(text.out, Not(HasSubstr("\x1b")));
  EXPECT_THAT(text.out, Not(HasSubstr("\nnothing is wrong")));
  EXPECT_THAT(text.err, HasSubstr("warnings: 1"));
  const CommandResult json = RunCommand("shiftmap-convert", {"check", "--json", log});
  EXPECT_EQ(json.exit_code, 8);
  const Json document = Json::parse(json.out);
  EXPECT_EQ(document["findings"][0]["code"], "bearing_sign");
  EXPECT_EQ(document["vehicle"], run.info.vehicle);
}

TEST(OwnLogs, ALogThatMakesNoMapHasExitCodeThreeAndIsStillDescribed) {
  shiftmap::Run run = ReadRunLog(Shift().Log(0))->run;
  run.scans.clear();
  const std::string log = Shift().File("no_scans.mcap");
  ASSERT_TRUE(WriteRunLog(run, log).ok());
  const CommandResult result = RunCommand("shiftmap-convert", {"check", "--json", log});
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_EQ(CountLines(result.err), 1);
  EXPECT_THAT(result.err, HasSubstr("no map can be made of it: the log has no scans"));
  EXPECT_EQ(Json::parse(result.out)["findings"][0]["code"], "no_scans");
}

TEST(OwnLogs, DamageIsAFindingToo) {
  const std::string whole = ReadFile(Shift().Log(0));
  const std::string log = Shift().File("damaged.mcap");
  WriteFile(log, whole.substr(0, whole.size() / 2));
  const CommandResult cut = RunCommand("shiftmap-convert", {"check", log});
  EXPECT_EQ(cut.exit_code, 8);
  EXPECT_THAT(cut.out, HasSubstr("warning: truncated"));
  std::string flipped = whole;
  flipped[whole.size() / 2] = static_cast<char>(flipped[whole.size() / 2] ^ 1);
  WriteFile(log, flipped);
  const CommandResult wrong = RunCommand("shiftmap-convert", {"check", log});
  EXPECT_EQ(wrong.exit_code, 3);
  EXPECT_THAT(wrong.out, HasSubstr("error: unreadable"));
  ExpectError("shiftmap-convert", {"check", Shift().File("nowhere.mcap")}, 6, "nowhere.mcap");
  ExpectError("shiftmap-convert", {"check", Shift().Places()}, 3, "not an mcap file");
}

}  // namespace
}  // namespace shiftmap::testing

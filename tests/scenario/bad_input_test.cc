// SPDX-License-Identifier: Apache-2.0
//
// What the programs say to files that they cannot use.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "mapstore/codec/run_log.h"
#include "mapstore/codec/run_log_messages.h"
#include "proto/mcap/writer.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

constexpr int kBadInput = 3;
constexpr int kNotFound = 6;

// A command line that reads one file.
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

using Reader = std::function<void(const std::string& file, int exit_code)>;

class BadInputTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new World({"--shifts", "2", "--duration-s", "60", "--groups", "10", "--size-m", "20"});
    RunForJson("shiftmap-mapper",
               {"build", "--store", world_->File("good.db"), "--area", "floor", world_->Log(0)});
  }
  static void TearDownTestSuite() {
    delete world_;
    world_ = nullptr;
  }

  BadInputTest() : store_(folder_.File("maps.db")), bad_(folder_.File("bad")) {
    std::filesystem::copy_file(world_->File("good.db"), store_);
    WriteFile(folder_.File("survey.csv"),
              "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\nA,1,1,2,0.1,0.1,1\n");
  }

  // Every command that reads a run log says this about it.
  void ExpectBadLog(int exit_code, const std::string& why) const {
    for (const char* prior : {"published", "none"}) {
      const Arguments build = {
          "build", "--store", store_, "--area", "floor", "--prior", prior, bad_};
      ExpectError("shiftmap-mapper", build, exit_code, "run log '" + bad_ + "'");
      ExpectError("shiftmap-mapper", build, exit_code, why);
    }
    const Arguments run = {"run", "--store", store_, "--area", "floor", bad_};
    ExpectError("shiftmap-localizer", run, exit_code, "run log '" + bad_ + "'");
    ExpectError("shiftmap-localizer", run, exit_code, why);
  }

  // Every command that reads a store says this about it.
  void ExpectBadStore(int exit_code, const std::string& why) const {
    const std::string log = world_->Log(1);
    const std::vector<std::pair<std::string, Arguments>> commands = {
        {"shiftmap-mapper", {"build", log}},
        {"shiftmap-mapper", {"build", "--prior", "none", log}},
        {"shiftmap-mapper", {"import", folder_.File("survey.csv")}},
        {"shiftmap-mapper", {"import", "--dry-run", folder_.File("survey.csv")}},
    };
    if (std::filesystem::exists(bad_)) {
      for (const auto& [program, words] : commands) ExpectBadStore(program, words, exit_code, why);
    }
    ExpectBadStore("shiftmap-localizer", {"run", log}, exit_code, why);
    for (const char* list : {"versions", "show", "modes", "sightings", "runs"}) {
      ExpectBadStore("shiftmap-inspect", {list}, exit_code, why);
    }
    ExpectBadStore("shiftmap-inspect", {"history", "L01"}, exit_code, why);
    ExpectBadStore("shiftmap-inspect", {"plot", "--output", folder_.File("x.svg")}, exit_code, why);
    ExpectBadStore("shiftmap-inspect",
                   {"export", "--snapshot", "--output", folder_.File("x.db")},
                   exit_code,
                   why);
    ExpectBadStore("shiftmap-eval", {"map", world_->Places()}, exit_code, why);
    ExpectError("shiftmap-inspect", {"areas", "--store", bad_}, exit_code, why);
  }

  void ExpectBadStore(const std::string& program,
                      Arguments arguments,
                      int exit_code,
                      const std::string& why) const {
    arguments.insert(arguments.end(), {"--store", bad_, "--area", "floor"});
    ExpectError(program, arguments, exit_code, "map store '" + bad_ + "': " + why);
  }

  // The shift of run 1 as a vehicle recorded it.
  static shiftmap::Run ReadShift() {
    StatusOr<RunLog> log = ReadRunLog(world_->Log(1));
    EXPECT_TRUE(log.ok()) << Message(log.status());
    return log.ok() ? std::move(log->run) : shiftmap::Run();
  }

  // Writes what WriteRunLog() refuses to write.
  void PutUnchecked(const shiftmap::Run& run) const {
    std::string bytes;
    mcap::Writer writer(
        [&bytes](std::string_view more) {
          bytes.append(more);
          return OkStatus();
        },
        {});
    const auto add_channel = [&](const RunLogTopic& topic) {
      return writer.AddChannel(
          writer.AddSchema(topic.schema_name, "protobuf", RunLogSchema()), topic.topic, "protobuf");
    };
    const std::uint16_t odometry = add_channel(kOdometryTopic);
    const std::uint16_t landmarks = add_channel(kLandmarksTopic);
    const auto time_of = [](Stamp stamp) {
      return static_cast<std::uint64_t>(ToNanoseconds(stamp));
    };
    for (const OdometrySample& sample : run.odometry) {
      ASSERT_TRUE(writer.Write(odometry, time_of(sample.stamp), EncodeOdometry(sample)).ok());
    }
    for (const Scan& scan : run.scans) {
      ASSERT_TRUE(writer.Write(landmarks, time_of(scan.stamp), EncodeScan(scan)).ok());
    }
    ASSERT_TRUE(writer.Finish().ok());
    WriteFile(bad_, bytes);
  }

  static World* world_;
  TempDir folder_;
  std::string store_;  // A good one.
  std::string bad_;    // The file that is not.
};

World* BadInputTest::world_ = nullptr;

TEST_F(BadInputTest, MissingRunLog) { ExpectBadLog(kNotFound, "does not exist"); }

TEST_F(BadInputTest, TextAsRunLog) {
  WriteFile(bad_, "12:00 left the garage\n");
  ExpectBadLog(kBadInput, "not an mcap file");
}

TEST_F(BadInputTest, EmptyRunLog) {
  WriteFile(bad_, "");
  ExpectBadLog(kBadInput, "");
}

TEST_F(BadInputTest, RunLogWithoutOdometry) {
  shiftmap::Run run = ReadShift();
  run.odometry.clear();
  PutUnchecked(run);
  ExpectBadLog(kBadInput, "no odometry");
  ExpectError("shiftmap-localizer",
              {"run", "--store", store_, "--area", "floor", "-"},
              kBadInput,
              "no odometry",
              {.input = ReadFile(bad_)});
}

TEST_F(BadInputTest, RunLogThatGoesBackwardsInTime) {
  shiftmap::Run run = ReadShift();
  std::swap(run.odometry[100].stamp, run.odometry[200].stamp);
  PutUnchecked(run);
  ExpectBadLog(kBadInput, "backwards");
  ExpectError("shiftmap-localizer",
              {"run", "--store", store_, "--area", "floor", "-"},
              kBadInput,
              "run log '-'",
              {.input = ReadFile(bad_)});
}

TEST_F(BadInputTest, RunLogWithScansThatGoBackwardsInTime) {
  shiftmap::Run run = ReadShift();
  std::swap(run.scans[10].stamp, run.scans[20].stamp);
  PutUnchecked(run);
  ExpectBadLog(kBadInput, "backwards");
}

TEST_F(BadInputTest, RunLogWithNumbersThatAreNone) {
  shiftmap::Run run = ReadShift();
  run.odometry[50].v_mps = std::numeric_limits<double>::quiet_NaN();
  PutUnchecked(run);
  ExpectBadLog(kBadInput, "expected finite numbers");

  run = ReadShift();
  for (Scan& scan : run.scans) {
    for (Observation& observation : scan.observations) {
      observation.z.x() = std::numeric_limits<double>::infinity();
    }
  }
  PutUnchecked(run);
  ExpectBadLog(kBadInput, "expected finite numbers");
}

TEST_F(BadInputTest, RunLogWithABitFlipped) {
  std::string bytes = ReadFile(world_->Log(1));
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 0x10);
  WriteFile(bad_, bytes);
  ExpectBadLog(kBadInput, "");
}

// A vehicle that lost power hands in what it has.
TEST_F(BadInputTest, CutOffRunLogIsUsed) {
  ASSERT_TRUE(WriteRunLog(ReadShift(), bad_, {.compress = true, .chunk_bytes = 4096}).ok());
  const std::string whole = ReadFile(bad_);
  WriteFile(bad_, whole.substr(0, whole.size() * 3 / 5));

  const Arguments run = {"run", "--store", store_, "--area", "floor", bad_, "--json"};
  const CommandResult localized = RunCommand("shiftmap-localizer", run);
  EXPECT_EQ(localized.exit_code, 0) << localized.err;
  EXPECT_EQ(CountLines(localized.err), 1) << localized.err;
  EXPECT_TRUE(localized.err.starts_with("shiftmap-localizer: warning: run log '" + bad_ + "': "))
      << localized.err;
  const Json document = Json::parse(localized.out);
  EXPECT_EQ(document["truncated"], true);
  EXPECT_GT(document["frames"], 50);

  const CommandResult built = RunCommand(
      "shiftmap-mapper", {"build", "--store", store_, "--area", "floor", bad_, "--json"});
  EXPECT_EQ(built.exit_code, 0) << built.err;
  EXPECT_EQ(CountLines(built.err), 1) << built.err;
  EXPECT_TRUE(built.err.starts_with("shiftmap-mapper: warning: run log '" + bad_ + "': "))
      << built.err;
  EXPECT_EQ(Json::parse(built.out)["runs"].size(), 1u);

  Arguments quiet = run;
  quiet.emplace_back("--quiet");
  EXPECT_EQ(RunCommand("shiftmap-localizer", quiet).err, "");
}

// Not a whole night for one log.
TEST_F(BadInputTest, ADamagedLogAmongOthersIsLeftOutByName) {
  WriteFile(bad_, "");
  const CommandResult built =
      RunCommand("shiftmap-mapper",
                 {"build", "--store", store_, "--area", "floor", bad_, world_->Log(1), "--json"});
  EXPECT_EQ(built.exit_code, 0) << built.err;
  EXPECT_EQ(CountLines(built.err), 1) << built.err;
  const Json document = Json::parse(built.out);
  EXPECT_EQ(document["runs"].size(), 1u);
  ASSERT_EQ(document["rejected"].size(), 1u);
  const std::string reason = document["rejected"][0]["reason"];
  EXPECT_NE(reason.find("run log '" + bad_ + "': not an mcap file"), std::string::npos) << reason;

  ExpectError("shiftmap-mapper",
              {"build", "--store", store_, "--area", "floor", bad_, world_->Log(1)},
              kBadInput,
              "run log '" + bad_ + "'");
}

// Where none is left, whoever mends the recorders wants all of them.
TEST_F(BadInputTest, LogsOfWhichNoneCanBeUsedAreAllNamed) {
  WriteFile(bad_, "");
  shiftmap::Run run = ReadShift();
  for (Scan& scan : run.scans) scan.observations.clear();
  const std::string second = folder_.File("saw_nothing.mcap");
  ASSERT_TRUE(WriteRunLog(run, second, {}).ok());
  run.info.vehicle = "another";
  run.info.uuid.clear();
  const std::string third = folder_.File("blind.mcap");
  ASSERT_TRUE(WriteRunLog(run, third, {}).ok());
  const std::string cut = folder_.File("cut.mcap");
  WriteFile(cut, "mcap");
  const std::string mapped = world_->Log(0);
  const auto error_of = [&](const Arguments& logs) {
    Arguments build = {"build", mapped, "--store", store_, "--area", "floor"};
    build.insert(build.end(), logs.begin(), logs.end());
    const CommandResult built = RunCommand("shiftmap-mapper", build);
    EXPECT_EQ(built.exit_code, kBadInput) << built.err;
    EXPECT_EQ(CountLines(built.err), 1) << built.err;
    EXPECT_THAT(built.err, Not(HasSubstr("run_000")));
    return built.err;
  };
  EXPECT_THAT(error_of({bad_, second, third}),
              AllOf(HasSubstr(bad_),
                    HasSubstr("'saw_nothing': no identified landmark is seen"),
                    HasSubstr("'blind': no identified landmark is seen")));
  EXPECT_THAT(error_of({bad_, cut}), AllOf(HasSubstr(bad_), HasSubstr(cut)));
}

// A recorder may write the name in another way than who made the area.
TEST_F(BadInputTest, ANewAreaWhoseNameDiffersByCaseAloneIsNamed) {
  const auto warning_of = [&](const std::string& area) {
    const CommandResult built =
        RunCommand("shiftmap-mapper", {"build", "--store", store_, "--area", area, world_->Log(1)});
    EXPECT_EQ(built.exit_code, 0) << built.err;
    return built.err;
  };
  EXPECT_EQ(warning_of("floors"), "");
  EXPECT_EQ(warning_of("Floor"),
            "shiftmap-mapper: warning: area 'Floor' is new beside area 'floor'\n");
}

TEST_F(BadInputTest, MissingStore) { ExpectBadStore(kNotFound, "does not exist"); }

TEST_F(BadInputTest, TextAsStore) {
  WriteFile(bad_, "This is not a database, but long enough to look at.\n");
  ExpectBadStore(kBadInput, "");
}

TEST_F(BadInputTest, EmptyFileAsStore) {
  WriteFile(bad_, "");
  ExpectBadStore(kBadInput, "not a map store");
  EXPECT_EQ(ReadFile(bad_), "");
}

TEST_F(BadInputTest, FolderAsStore) {
  std::filesystem::create_directory(bad_);
  ExpectBadStore(kBadInput, "not a map store");
}

TEST_F(BadInputTest, StoreOfANewerSchema) {
  // SQLite keeps user_version big-endian at byte 60 of the file.
  std::string bytes = ReadFile(store_);
  bytes.replace(60, 4, std::string("\0\0\0\x63", 4));
  WriteFile(bad_, bytes);
  ExpectBadStore(kBadInput, "schema version 99");
  EXPECT_EQ(ReadFile(bad_), bytes);
}

TEST_F(BadInputTest, CutOffStore) {
  const std::string bytes = ReadFile(store_);
  WriteFile(bad_, bytes.substr(0, bytes.size() / 2));
  ExpectBadStore("shiftmap-localizer", {"run", world_->Log(1)}, kBadInput, "");
  ExpectBadStore("shiftmap-inspect", {"show"}, kBadInput, "");
}

TEST_F(BadInputTest, MissingArea) {
  const std::string area = "area 'cellar'";
  const Arguments where = {"--store", store_, "--area", "cellar"};
  const auto expect = [&](const std::string& program, Arguments words) {
    words.insert(words.end(), where.begin(), where.end());
    ExpectError(program, words, kNotFound, area);
  };
  expect("shiftmap-localizer", {"run", world_->Log(1)});
  for (const char* list : {"versions", "show", "modes", "sightings", "runs"}) {
    expect("shiftmap-inspect", {list});
  }
  expect("shiftmap-inspect", {"plot", "--output", folder_.File("x.svg")});
  expect("shiftmap-inspect", {"export", "--snapshot", "--output", folder_.File("x.db")});
  expect("shiftmap-eval", {"map", world_->Places()});
  expect("shiftmap-mapper", {"build", "--prior", "1", world_->Log(1)});
}

TEST_F(BadInputTest, MissingVersionOrLandmark) {
  const Arguments where = {"--store", store_, "--area", "floor"};
  const auto expect = [&](const std::string& program, Arguments words, const std::string& what) {
    words.insert(words.end(), where.begin(), where.end());
    ExpectError(program, words, kNotFound, what);
  };
  expect("shiftmap-inspect", {"show", "--version", "42"}, "version 42");
  expect("shiftmap-eval", {"map", "--version", "42", world_->Places()}, "version 42");
  expect("shiftmap-mapper", {"build", "--prior", "42", world_->Log(1)}, "version 42");
  expect("shiftmap-inspect", {"history", "NOBODY"}, "'NOBODY'");
  expect("shiftmap-inspect", {"modes", "NOBODY"}, "'NOBODY'");
}

TEST_F(BadInputTest, BadSurvey) {
  const Arguments import = {"import", "--store", store_, "--area", "floor", bad_};
  ExpectError("shiftmap-mapper", import, kNotFound, bad_);
  for (const char* text : {"",
                           "signature,x\n",
                           "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\n",
                           "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\nA,1,nan,2,1,1,1\n",
                           "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\nA,1,1,2,0,1,1\n",
                           "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\nA,1,1,2,1,1,2\n"}) {
    SCOPED_TRACE(text);
    WriteFile(bad_, text);
    ExpectError("shiftmap-mapper", import, kBadInput, bad_);
  }
}

TEST_F(BadInputTest, BadTrajectory) {
  const Arguments evaluate = {"trajectory", bad_, world_->Truth(1)};
  ExpectError("shiftmap-eval", evaluate, kNotFound, bad_);
  for (const char* text : {"",
                           "t x y\n",
                           "1 2 3 0 0 0 0\n",
                           "1 nan 3 0 0 0 0 1\n",
                           "2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n",
                           "1 0 0 0 0 0 0 1\n"}) {
    SCOPED_TRACE(text);
    WriteFile(bad_, text);
    ExpectError("shiftmap-eval", evaluate, kBadInput, bad_);
  }
}

TEST_F(BadInputTest, BadTruePlaces) {
  const Arguments evaluate = {"map", "--store", store_, "--area", "floor", bad_};
  ExpectError("shiftmap-eval", evaluate, kNotFound, bad_);
  WriteFile(bad_, "signature,x_m\nA,1\n");
  ExpectError("shiftmap-eval", evaluate, kBadInput, bad_);
  WriteFile(bad_, "signature,x_m,y_m\nNOBODY,1,1\n");
  ExpectError("shiftmap-eval", evaluate, kBadInput, bad_);
}

TEST_F(BadInputTest, BadDataSet) {
  const Arguments convert = {
      "utias", bad_, "--robot", "1", "--output", folder_.File("converted.mcap")};
  ExpectError("shiftmap-convert", convert, kNotFound, bad_);
  std::filesystem::create_directory(bad_);
  ExpectError("shiftmap-convert", convert, kNotFound, bad_ + "/");
  for (const char* name : {"Barcodes.dat",
                           "Landmark_Groundtruth.dat",
                           "Robot1_Odometry.dat",
                           "Robot1_Measurement.dat",
                           "Robot1_Groundtruth.dat"}) {
    WriteFile(bad_ + "/" + name, "one two\n");
  }
  ExpectError("shiftmap-convert", convert, kBadInput, bad_ + "/");
  EXPECT_FALSE(std::filesystem::exists(folder_.File("converted.mcap")));
}

}  // namespace
}  // namespace shiftmap::testing

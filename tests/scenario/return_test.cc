// SPDX-License-Identifier: Apache-2.0
//
// Shift reports on their way into the store.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/clock.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

constexpr int kBadInput = 3;
constexpr int kNothingToDo = 5;
constexpr int kNotFound = 6;

class ReturnTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    world_ = new World({"--shifts", "3", "--duration-s", "60", "--groups", "10", "--size-m", "20"});
    RunForJson("shiftmap-mapper",
               {"build", "--store", world_->File("good.db"), "--area", "floor", world_->Log(0)});
    RunForJson("shiftmap-localizer",
               {"run",
                "--store",
                world_->File("good.db"),
                "--area",
                "floor",
                "--report",
                world_->File("good.report"),
                world_->Log(1)});
  }
  static void TearDownTestSuite() {
    delete world_;
    world_ = nullptr;
  }

  ReturnTest()
      : store_(folder_.File("maps.db")),
        report_(world_->File("good.report")),
        bad_(folder_.File("bad.report")) {
    std::filesystem::copy_file(world_->File("good.db"), store_);
  }

  Arguments Return(const std::vector<std::string>& reports) const {
    Arguments words = {"return", "--store", store_};
    words.insert(words.end(), reports.begin(), reports.end());
    return words;
  }

  // A run of the second log on the map.
  Arguments Run(Arguments more) const {
    more.insert(more.begin(), {"run", "--store", store_, "--area", "floor"});
    more.push_back(world_->Log(1));
    return more;
  }

  static ShiftReport Good() {
    const StatusOr<ShiftReport> report = ReadShiftReport(world_->File("good.report"));
    EXPECT_TRUE(report.ok()) << Message(report.status());
    return *report;
  }

  // The same shift at another time.
  static void ShiftBy(Duration by, ShiftReport* report) {
    for (Stamp* const stamp : {&report->begin, &report->end}) *stamp += by;
    for (VisitEvidence& visit : report->evidence) {
      visit.begin += by;
      visit.end += by;
    }
    for (Decision& decision : report->decisions) decision.stamp += by;
    for (UnmappedSighting& sighting : report->sightings) {
      sighting.first += by;
      sighting.last += by;
    }
  }

  // `bad_` is not taken, and the store stays as it is.
  void ExpectRefused(int exit_code, const std::string& why) const {
    const std::string before = ReadFile(store_);
    ExpectError("shiftmap-localizer", Return({bad_}), exit_code, why);
    EXPECT_TRUE(ReadFile(store_) == before);
  }

  static World* world_;
  TempDir folder_;
  std::string store_;
  std::string report_;
  std::string bad_;
};

World* ReturnTest::world_ = nullptr;

TEST_F(ReturnTest, ChangesTheProbabilities) {
  const std::string at = fmt::format("{}", ToSecondsSinceEpoch(Good().end));
  const Arguments show = {"show", "--store", store_, "--area", "floor", "--at", at};
  const Json before = RunForJson("shiftmap-inspect", show);
  const Json result = RunForJson("shiftmap-localizer", Return({report_}));
  ASSERT_EQ(result["reports"].size(), 1u);
  EXPECT_EQ(result["reports"][0]["uuid"], Good().uuid);
  EXPECT_EQ(result["reports"][0]["duplicate"], false);
  EXPECT_EQ(result["reports"][0]["evidence_rows"], Good().evidence.size());
  EXPECT_NE(RunForJson("shiftmap-inspect", show)["groups"], before["groups"]);
}

// A log of another area: that is a result with an exit code of its own, and no report.
TEST_F(ReturnTest, AShiftThatNeverFoundItsPoseReturnsNothing) {
  WriteFile(bad_,
            "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\n"
            "X1,1,0,0,0.1,0.1,1\nX2,1,5,0,0.1,0.1,1\nX3,1,0,7,0.1,0.1,1\nX4,1,9,9,0.1,0.1,1\n");
  RunForJson("shiftmap-mapper",
             {"import", "--store", store_, "--area", "yard", "--stamp-s", "1767600000", bad_});
  const std::string before = ReadFile(store_);
  const CommandResult result = RunCommand(
      "shiftmap-localizer",
      {"run", "--store", store_, "--area", "yard", "--return", "--json", world_->Log(1)});
  EXPECT_EQ(result.exit_code, 7) << result.err;
  EXPECT_EQ(CountLines(result.err), 1) << result.err;
  EXPECT_NE(result.err.find("area 'yard' has 0 of the 10 landmarks"), std::string::npos)
      << result.err;
  EXPECT_NE(result.err.find("area 'floor' has 10"), std::string::npos) << result.err;
  EXPECT_EQ(Json::parse(result.out)["localized"], false);
  EXPECT_TRUE(ReadFile(store_) == before);
}

TEST_F(ReturnTest, AShiftThatReadNoSignatureSaysSo) {
  StatusOr<RunLog> log = ReadRunLog(world_->Log(1));
  ASSERT_TRUE(log.ok());
  for (Scan& scan : log->run.scans) scan.observations.clear();
  const std::string blind = folder_.File("blind.mcap");
  ASSERT_TRUE(WriteRunLog(log->run, blind).ok());
  const CommandResult result = RunCommand(
      "shiftmap-localizer", {"run", "--store", store_, "--area", "floor", "--return", blind});
  EXPECT_EQ(result.exit_code, 7);
  EXPECT_EQ(CountLines(result.err), 1) << result.err;
  EXPECT_NE(result.err.find("not localized, it saw no landmark with a signature"),
            std::string::npos)
      << result.err;
}

// Areas may name their landmarks alike, and then the number of names does not tell them apart.
TEST_F(ReturnTest, AShiftInAnAreaOfTheSameNamesIsToldOfTheOtherArea) {
  std::string survey = "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\n";
  for (int i = 1; i <= 10; ++i) {
    survey += fmt::format("L{:02},1,{},{},0.1,0.1,1\n", i, i * i * 37 % 101, i * 53 % 97);
  }
  WriteFile(bad_, survey);
  RunForJson("shiftmap-mapper",
             {"import", "--store", store_, "--area", "yard", "--stamp-s", "1767600000", bad_});
  const CommandResult result = RunCommand(
      "shiftmap-localizer", {"run", "--store", store_, "--area", "yard", world_->Log(1)});
  EXPECT_EQ(result.exit_code, 7) << result.err;
  EXPECT_NE(result.err.find("area 'yard' has 10 of the 10 landmarks that it saw; area 'floor' has "
                            "10"),
            std::string::npos)
      << result.err;
}

TEST_F(ReturnTest, SecondTimeIsNothingToDo) {
  RunForJson("shiftmap-localizer", Return({report_}));
  const std::string before = ReadFile(store_);
  const CommandResult again = RunCommand("shiftmap-localizer", Return({report_}));
  EXPECT_EQ(again.exit_code, kNothingToDo);
  EXPECT_EQ(CountLines(again.err), 1) << again.err;
  EXPECT_TRUE(again.err.starts_with("shiftmap-localizer: map store '" + store_ + "'")) << again.err;

  Arguments words = Return({report_, report_});
  words.emplace_back("--json");
  const CommandResult json = RunCommand("shiftmap-localizer", words);
  EXPECT_EQ(json.exit_code, kNothingToDo);
  const Json answer = Json::parse(json.out);
  for (const Json& result : answer["reports"]) EXPECT_EQ(result["duplicate"], true);
  EXPECT_TRUE(ReadFile(store_) == before);
}

TEST_F(ReturnTest, ReturnedByTheRunAndAgainByFile) {
  const std::string report = folder_.File("shift.report");
  RunForJson("shiftmap-localizer", Run({"--return", "--report", report}));
  EXPECT_EQ(RunCommand("shiftmap-localizer", Return({report})).exit_code, kNothingToDo);
}

// As `return` does: whoever hands a report in learns that it tells the map nothing.
TEST_F(ReturnTest, ARunThatIsMappedSaysThatItsReportIsKeptAside) {
  const Arguments run = {"run", "--store", store_, "--area", "floor", "--return", world_->Log(0)};
  const Json returned = RunForJson("shiftmap-localizer", run)["returned"];
  const int rows = returned["evidence_rows"];
  EXPECT_GT(rows, 0);
  EXPECT_EQ(returned["set_aside"],
            Json::parse(R"([{"reason": "the map was built from its run", "rows": )" +
                        std::to_string(rows) + "}]"));
  const CommandResult again = RunCommand("shiftmap-localizer", run);
  EXPECT_NE(again.out.find("of them kept aside: "), std::string::npos) << again.out;

  const CommandResult other = RunCommand("shiftmap-localizer", Run({"--return"}));
  EXPECT_NE(other.out.find("\nreturned "), std::string::npos) << other.out;
  EXPECT_EQ(other.out.find("kept aside"), std::string::npos) << other.out;
  EXPECT_FALSE(RunForJson("shiftmap-localizer", Run({})).contains("returned"));
}

TEST_F(ReturnTest, FromTheFutureIsRefusedAndNothingIsWritten) {
  ShiftReport report = Good();
  ShiftBy(SystemNow() - report.end + std::chrono::hours(24), &report);
  ASSERT_TRUE(WriteShiftReport(report, bad_).ok());
  ExpectRefused(kBadInput, "shift report '" + bad_ + "'");
  ExpectRefused(kBadInput, "expected at most 600");
  // A good one before it is not returned either.
  const std::string before = ReadFile(store_);
  ExpectError("shiftmap-localizer", Return({report_, bad_}), kBadInput, bad_);
  EXPECT_TRUE(ReadFile(store_) == before);
  Arguments tolerant = Return({bad_});
  tolerant.insert(tolerant.end(), {"--clock-tolerance-s", "100000"});
  RunForJson("shiftmap-localizer", tolerant);
}

TEST_F(ReturnTest, ARunOfALogFromTheFutureWritesNothing) {
  StatusOr<RunLog> log = ReadRunLog(world_->Log(1));
  ASSERT_TRUE(log.ok());
  const Duration ahead = SystemNow() - log->run.odometry.back().stamp + std::chrono::hours(24);
  for (OdometrySample& sample : log->run.odometry) sample.stamp += ahead;
  for (Scan& scan : log->run.scans) scan.stamp += ahead;
  ASSERT_TRUE(WriteRunLog(log->run, folder_.File("future.mcap")).ok());
  const std::string before = ReadFile(store_);
  ExpectError("shiftmap-localizer",
              {"run",
               "--store",
               store_,
               "--area",
               "floor",
               "--return",
               "--report",
               bad_,
               "--trajectory",
               folder_.File("x.tum"),
               folder_.File("future.mcap")},
              kBadInput,
              "expected at most 600");
  EXPECT_TRUE(ReadFile(store_) == before);
  EXPECT_FALSE(std::filesystem::exists(bad_));
  EXPECT_FALSE(std::filesystem::exists(folder_.File("x.tum")));
}

// As a build does with its log: what a person hands in is named and counts.
TEST_F(ReturnTest, OfAClockThatWasNotSetIsNamedAndCounts) {
  ShiftReport report = Good();
  ShiftBy(Stamp() - report.begin, &report);
  ASSERT_TRUE(WriteShiftReport(report, bad_).ok());
  const CommandResult returned = RunCommand("shiftmap-localizer", Return({bad_}));
  EXPECT_EQ(returned.exit_code, 0) << returned.err;
  EXPECT_EQ(CountLines(returned.err), 1) << returned.err;
  EXPECT_NE(returned.err.find("'" + bad_ + "': begins at 1970-01-01 00:00:00 UTC"),
            std::string::npos)
      << returned.err;
  EXPECT_EQ(RunCommand("shiftmap-localizer", Return({bad_})).exit_code, kNothingToDo);

  StatusOr<RunLog> log = ReadRunLog(world_->Log(1));
  ASSERT_TRUE(log.ok());
  const Duration by = Stamp() - log->run.odometry.front().stamp;
  for (OdometrySample& sample : log->run.odometry) sample.stamp += by;
  for (Scan& scan : log->run.scans) scan.stamp += by;
  const std::string unset = folder_.File("unset.mcap");
  ASSERT_TRUE(WriteRunLog(log->run, unset).ok());
  const CommandResult run =
      RunCommand("shiftmap-localizer",
                 {"run", "--store", store_, "--area", "floor", "--return", "--json", unset});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(CountLines(run.err), 1) << run.err;
  EXPECT_NE(run.err.find("'" + unset + "': begins at 1970-01-01"), std::string::npos) << run.err;
}

// A run knows what was known when its log began: returned reports about it do not change it.
TEST_F(ReturnTest, ARunAgainIsWhatItWas) {
  const Arguments run = Run({});
  const Json before = RunForJson("shiftmap-localizer", run);
  RunForJson("shiftmap-localizer", Return({report_}));
  EXPECT_EQ(RunForJson("shiftmap-localizer", run)["mode_probabilities"],
            before["mode_probabilities"]);
}

TEST_F(ReturnTest, KnownAndUnknownTogetherIsDone) {
  RunForJson("shiftmap-localizer", Return({report_}));
  ShiftReport other = Good();
  other.uuid = RandomUuid();
  ASSERT_TRUE(WriteShiftReport(other, bad_).ok());
  const Json result = RunForJson("shiftmap-localizer", Return({report_, bad_}));
  EXPECT_EQ(result["reports"][0]["duplicate"], true);
  EXPECT_EQ(result["reports"][1]["duplicate"], false);
}

TEST_F(ReturnTest, MissingFiles) {
  ExpectRefused(kNotFound, "shift report '" + bad_ + "': does not exist");
  ExpectError("shiftmap-localizer",
              {"return", "--store", folder_.File("no.db"), report_},
              kNotFound,
              "map store '" + folder_.File("no.db") + "'");
}

TEST_F(ReturnTest, DamagedReports) {
  const std::string bytes = ReadFile(report_);
  const std::vector<std::string> damaged = {
      "",
      "The shift went well.\n",
      bytes.substr(0, bytes.size() / 2),
      bytes.substr(1),
      std::string(bytes.size(), '\0'),
      std::string(bytes.size(), '\xff'),
  };
  for (const std::string& text : damaged) {
    WriteFile(bad_, text);
    ExpectRefused(kBadInput, "shift report '" + bad_ + "'");
  }
}

// A file that one byte was changed in is refused or taken, but nothing else.
TEST_F(ReturnTest, FlippedBytes) {
  const std::string bytes = ReadFile(report_);
  const std::size_t step = bytes.size() / 40 + 1;
  for (std::size_t i = 0; i < bytes.size(); i += step) {
    std::string flipped = bytes;
    flipped[i] = static_cast<char>(flipped[i] ^ 0x55);
    WriteFile(bad_, flipped);
    Arguments words = Return({bad_});
    const CommandResult result = RunCommand("shiftmap-localizer", words);
    EXPECT_TRUE(result.exit_code == 0 || result.exit_code == kBadInput ||
                result.exit_code == kNotFound || result.exit_code == kNothingToDo)
        << "byte " << i << ": exit code " << result.exit_code << ": " << result.err;
    EXPECT_EQ(CountLines(result.err), result.exit_code == 0 ? 0 : 1) << result.err;
  }
}

TEST_F(ReturnTest, ReportOfAnotherMap) {
  ShiftReport report = Good();
  report.content_hash.back() = report.content_hash.back() == '0' ? '1' : '0';
  ASSERT_TRUE(WriteShiftReport(report, bad_).ok());
  ExpectRefused(kBadInput, "content hash");

  report = Good();
  report.area = "cellar";
  ASSERT_TRUE(WriteShiftReport(report, bad_).ok());
  ExpectRefused(kNotFound, "'cellar'");

  report = Good();
  report.version = VersionNumber(17);
  ASSERT_TRUE(WriteShiftReport(report, bad_).ok());
  ExpectRefused(kNotFound, "version 17");
}

TEST_F(ReturnTest, OneDamagedReportHoldsUpAll) {
  WriteFile(bad_, "no report");
  const std::string before = ReadFile(store_);
  ExpectError("shiftmap-localizer", Return({report_, bad_}), kBadInput, bad_);
  EXPECT_TRUE(ReadFile(store_) == before);
}

TEST_F(ReturnTest, EmptyFileAsStore) {
  WriteFile(bad_, "");
  ExpectError(
      "shiftmap-localizer", {"return", "--store", bad_, report_}, kBadInput, "not a map store");
}

// Whatever --vehicle says: a run is its vehicle's, and counts once.
TEST_F(ReturnTest, ARunIsReportedInTheNameOfItsVehicle) {
  for (const char* vehicle : {"a", "b", "c"}) {
    RunForJson("shiftmap-localizer", Run({"--vehicle", vehicle, "--return"}));
  }
  int counting = 0;
  const Json reports =
      RunForJson("shiftmap-inspect", {"reports", "--store", store_, "--area", "floor"})["reports"];
  EXPECT_EQ(reports.size(), 3u);
  for (const Json& report : reports) {
    EXPECT_EQ(report["vehicle"], Good().vehicle);
    counting += report["set_aside"].empty();
  }
  EXPECT_EQ(counting, 1);
}

// The report is of a version that the new one does not go on from.
TEST_F(ReturnTest, TheFirstBuildAfterARollbackSaysWhatItSetsAside) {
  const Arguments map = {"--store", store_, "--area", "floor"};
  const auto with = [&](Arguments words) {
    words.insert(words.end(), map.begin(), map.end());
    return words;
  };
  const auto build = [&](int run) {
    const CommandResult built =
        RunCommand("shiftmap-mapper", with({"build", "--json", world_->Log(run)}));
    EXPECT_EQ(built.exit_code, 0) << built.err;
    const int set_aside = Json::parse(built.out)["reports_set_aside"];
    EXPECT_EQ(CountLines(built.err), set_aside) << built.err;
    if (set_aside > 0) {
      EXPECT_NE(built.err.find("version 3 sets 1 report aside"), std::string::npos) << built.err;
    }
    return set_aside;
  };
  EXPECT_EQ(build(1), 0);
  RunForJson("shiftmap-localizer", with({"run", "--return", world_->Log(2)}));
  const auto rows_counting = [&] {
    int rows = 0;
    const Json reports = RunForJson("shiftmap-inspect", with({"reports"}))["reports"];
    for (const Json& of : reports[0]["set_aside"]) rows += of["rows"].get<int>();
    return reports[0]["evidence_rows"].get<int>() - rows;
  };
  RunForJson("shiftmap-inspect", with({"rollback"}));
  EXPECT_GT(rows_counting(), 0) << "none counts any more";
  EXPECT_EQ(build(1), 1);
  EXPECT_EQ(rows_counting(), 0) << "some count";
  // What the run's log says is in the map.
  EXPECT_EQ(build(2), 0);
}

TEST_F(ReturnTest, ALogOfAnotherAreaIsNotReported) {
  StatusOr<RunLog> log = ReadRunLog(world_->Log(1));
  ASSERT_TRUE(log.ok());
  log->run.info.area = "hall";
  const std::string path = folder_.File("hall.mcap");
  ASSERT_TRUE(WriteRunLog(log->run, path).ok());
  Arguments words = {"run", "--store", store_, "--area", "floor", path};
  EXPECT_EQ(RunCommand("shiftmap-localizer", words).exit_code, 0);
  words.push_back("--return");
  ExpectError("shiftmap-localizer", words, kBadInput, "is of area 'hall', not 'floor'");
  const Json reports =
      RunForJson("shiftmap-inspect", {"reports", "--store", store_, "--area", "floor"});
  EXPECT_TRUE(reports["reports"].empty());
}

// An output that is an input, in every command that has both; a link is the same file.
TEST_F(ReturnTest, NoOutputReplacesWhatACommandReads) {
  constexpr int kUsage = 2;
  const std::string log = folder_.File("run.mcap");
  const std::string link = folder_.File("link");
  std::filesystem::copy_file(world_->Log(1), log);
  std::filesystem::create_symlink(store_, link);
  const auto size = [](const std::string& path) { return std::filesystem::file_size(path); };
  const auto of_store = size(store_);
  const auto of_log = size(log);
  const auto expect = [&](const char* program, Arguments words, const std::string& output) {
    words.insert(words.end(), {"--store", store_, "--area", "floor"});
    for (const std::string& path : {store_, link}) {
      Arguments all = words;
      all.insert(all.end(), {output, path});
      ExpectError(program, all, kUsage, path);
    }
  };
  for (const std::string output : {"--trajectory", "--report", "--recording"}) {
    expect("shiftmap-localizer", {"run", log}, output);
    ExpectError("shiftmap-localizer",
                {"run", "--store", store_, "--area", "floor", output, log, log},
                kUsage,
                log);
    ExpectError("shiftmap-localizer",
                {"run", "--store", store_, "--area", "floor", output, link, log, "--return"},
                kUsage,
                link);
  }
  for (const char* format : {"--csv", "--html", "--snapshot"}) {
    expect("shiftmap-inspect", {"export", format}, "--output");
  }
  expect("shiftmap-mapper", {"nightly", "plan", "--logs", folder_.path()}, "--output");
  ExpectError(
      "shiftmap-inspect", {"backup", "--store", store_, "--output", store_}, kUsage, store_);
  ExpectError("shiftmap-localizer",
              {"run",
               "--store",
               store_,
               "--area",
               "floor",
               "--report",
               folder_.File("same"),
               "--trajectory",
               folder_.File("same"),
               log},
              kUsage,
              folder_.File("same"));
  EXPECT_EQ(size(store_), of_store);
  EXPECT_EQ(size(log), of_log);
  EXPECT_FALSE(std::filesystem::exists(folder_.File("same")));
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
//
// What every program does with its command line, its output, and the disk.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "mapstore/cli/programs.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"

namespace shiftmap::testing {
namespace {

constexpr int kUsage = 2;
constexpr int kBadInput = 3;
constexpr int kTemporary = 75;

// Names and bytes of all files in a folder.
std::vector<std::pair<std::string, std::string>> Contents(const std::string& folder) {
  std::vector<std::pair<std::string, std::string>> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    files.emplace_back(entry.path().string(),
                       entry.is_regular_file() ? ReadFile(entry.path().string()) : "");
  }
  std::sort(files.begin(), files.end());
  return files;
}

struct Program {
  std::string name;
  std::vector<std::string> commands;
};

const std::vector<Program>& Programs() {
  static const auto* const programs = new std::vector<Program>{
      {"shiftmap-convert",
       {"carmen", "check", "csv", "lidar-json", "rosbag2", "utias", "victoria-park"}},
      {"shiftmap-eval", {"trajectory", "map"}},
      {"shiftmap-experiment",
       {"alignments",
        "engines",
        "ijrr-selectors",
        "ijrr-utias",
        "lidar-repeatability",
        "lidar-run",
        "localizer-bodies",
        "localizer-consistency",
        "localizer-decisions",
        "localizer-recorded",
        "localizer-states",
        "localizer-utias",
        "papers",
        "recurring-chains",
        "scale",
        "tiv-approximations",
        "tiv-mine",
        "tiv-posterior",
        "tiv-removal",
        "victoria-park"}},
      {"shiftmap-inspect",
       {"areas",    "versions", "show",     "modes",   "history", "sightings", "runs",
        "reports",  "audit",    "vehicles", "export",  "plot",    "diff",      "publish",
        "rollback", "verify",   "backup",   "restore", "compact", "migrate"}},
      {"shiftmap-localizer", {"run", "return", "serve", "ctl"}},
      {"shiftmap-mapper", {"build", "import"}},
      {"shiftmap-sim", {"mine", "open"}},
  };
  return *programs;
}

// The names below `Subcommands:` in a program's help.
std::set<std::string> CommandsIn(const std::string& help) {
  std::set<std::string> commands;
  std::istringstream lines(help.substr(std::min(help.find("Subcommands:"), help.size())));
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("  ") || line.starts_with("   ")) continue;
    commands.insert(line.substr(2, line.find(' ', 2) - 2));
  }
  return commands;
}

// A site file may have a table for each.
TEST(Programs, AreAllKnownToTheSiteFileWithTheirCommands) {
  for (const Program& program : Programs()) {
    const auto known =
        std::find_if(AllPrograms().begin(), AllPrograms().end(), [&](const ProgramCommands& other) {
          return "shiftmap-" + other.program == program.name;
        });
    ASSERT_NE(known, AllPrograms().end()) << program.name;
    const std::set<std::string> commands = CommandsIn(RunCommand(program.name, {"--help"}).out);
    EXPECT_FALSE(commands.empty()) << program.name;
    EXPECT_EQ(commands, std::set<std::string>(known->commands.begin(), known->commands.end()))
        << program.name;
  }
}

TEST(Programs, ReadOneSiteFile) {
  const TempDir dir;
  const std::string path = dir.File("shiftmap.toml");
  WriteFile(path,
            "store = '" + dir.File("a.db") +
                "'\narea = 'floor'\nserver = 'maps.example.com:7443'\nlog-level = 'error'\n"
                "[build]\nselector = 'viterbi'\n[localizer.run]\ninitial-pose = 'auto'\n"
                "[history]\nlimit = 5\n[shiftmap-server]\nlisten = ':7443'\n");
  const CommandOptions options{.environment = {"SHIFTMAP_CONFIG=" + path}};
  for (const auto& [program, arguments] :
       std::vector<std::pair<std::string, Arguments>>{{"shiftmap-inspect", {"areas"}},
                                                      {"shiftmap-inspect", {"history", "L01"}},
                                                      {"shiftmap-localizer", {"run", "a.mcap"}},
                                                      {"shiftmap-mapper", {"build", "a.mcap"}}}) {
    // The file is read whole, and what is missing is the store or the log.
    EXPECT_EQ(RunCommand(program, arguments, options).exit_code, 6) << program;
  }
  WriteFile(path, "[build]\nselectro = 'viterbi'\n");
  EXPECT_EQ(RunCommand("shiftmap-inspect", {"config"}, options).exit_code, 0);
  ExpectError("shiftmap-mapper",
              {"build", "a.mcap"},
              kUsage,
              "unknown key 'build.selectro'; did you mean 'selector'?",
              options);
}

TEST(UsageTest, NoArguments) {
  for (const Program& program : Programs()) ExpectError(program.name, {}, kUsage, "required");
}

TEST(UsageTest, UnknownCommand) {
  for (const Program& program : Programs()) {
    ExpectError(program.name, {"frobnicate"}, kUsage, "'frobnicate'");
  }
}

TEST(UsageTest, UnknownOption) {
  const Arguments map = {"--store", "s", "--area", "a", "--frobnicate"};
  const auto expect = [&](const std::string& program, Arguments words) {
    words.insert(words.end(), map.begin(), map.end());
    ExpectError(program, words, kUsage, "--frobnicate");
  };
  for (const char* command : {"versions", "show", "modes", "sightings", "runs"}) {
    expect("shiftmap-inspect", {command});
  }
  expect("shiftmap-mapper", {"build", "x.mcap"});
  expect("shiftmap-mapper", {"import", "x.csv"});
  expect("shiftmap-localizer", {"run", "x.mcap"});
  expect("shiftmap-eval", {"map", "x.csv"});
  ExpectError("shiftmap-sim", {"open", "d", "--frobnicate"}, kUsage, "--frobnicate");
}

TEST(UsageTest, MissingRequiredOption) {
  for (const Program& program : Programs()) {
    for (const std::string& command : program.commands) {
      if (command == "papers") continue;  // Reads the tree that it is started in.
      ExpectError(program.name, {command}, kUsage, "required");
    }
  }
}

TEST(UsageTest, OptionWithoutItsValue) {
  const CommandResult result =
      RunCommand("shiftmap-inspect", {"--json", "show", "--area", "a", "--store"});
  EXPECT_EQ(result.exit_code, kUsage);
  EXPECT_EQ(CountLines(result.err), 1) << result.err;
  EXPECT_NE(result.err.find("--store"), std::string::npos) << result.err;
  EXPECT_EQ(Json::parse(result.out)["exit_code"], kUsage);
}

TEST(UsageTest, ValuesThatDoNotFit) {
  const Arguments map = {"--store", "s", "--area", "a"};
  const auto expect = [&](const std::string& program, Arguments words, const std::string& option) {
    words.insert(words.end(), map.begin(), map.end());
    ExpectError(program, words, kUsage, option);
  };
  expect("shiftmap-mapper", {"build", "--prior", "yesterday", "x.mcap"}, "--prior");
  expect("shiftmap-mapper", {"build", "--seed", "-x", "x.mcap"}, "--seed");
  expect("shiftmap-mapper", {"build", "--selector", "luck", "x.mcap"}, "--selector");
  expect("shiftmap-localizer", {"run", "--initial-pose", "1,2", "x.mcap"}, "--initial-pose");
  expect("shiftmap-localizer", {"run", "--initial-pose", "1,2,nan", "x.mcap"}, "--initial-pose");
  expect("shiftmap-localizer", {"run", "--initial-pose", "1,1e300,0", "x.mcap"}, "--initial-pose");
  expect("shiftmap-localizer", {"run", "--snapshot", "s", "x.mcap"}, "--snapshot");
  expect("shiftmap-localizer", {"run", "--alpha", "2", "x.mcap"}, "--alpha");
  expect("shiftmap-inspect", {"show", "--at", "noon"}, "--at");
  expect("shiftmap-inspect", {"export", "--output", "x"}, "--geojson");
  expect("shiftmap-inspect", {"plot", "weather", "--output", "x.svg"}, "weather");
  ExpectError("shiftmap-localizer", {"run", "--area", "a", "x.mcap"}, kUsage, "--store");
  ExpectError("shiftmap-localizer",
              {"run", "--area", "a", "--snapshot", "s", "--return", "x.mcap"},
              kUsage,
              "--return needs --store");
  ExpectError(
      "shiftmap-convert", {"utias", "d", "--robot", "9", "--output", "x"}, kUsage, "--robot");
}

TEST(UsageTest, HelpAndVersionGoToStandardOutput) {
  for (const Program& program : Programs()) {
    std::vector<Arguments> questions = {{"--help"}, {"--version"}};
    for (const std::string& command : program.commands) questions.push_back({command, "--help"});
    for (const Arguments& question : questions) {
      const CommandResult result = RunCommand(program.name, question);
      EXPECT_EQ(result.exit_code, 0) << program.name << " " << question.front();
      EXPECT_EQ(result.err, "");
      EXPECT_NE(result.out.find(program.name), std::string::npos) << result.out;
    }
  }
}

class OutputTest : public ::testing::Test {
 protected:
  OutputTest()
      : world_({"--shifts", "2", "--duration-s", "60", "--groups", "10", "--size-m", "20"}),
        store_(folder_.File("maps.db")) {
    RunForJson("shiftmap-mapper", {"build", "--store", store_, "--area", "floor", world_.Log(0)});
    WriteFile(folder_.File("survey.csv"),
              "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\nA,1,1,2,0.1,0.1,1\n");
  }

  // The words with the store and area added.
  Arguments OfMap(Arguments words) const {
    words.insert(words.end(), {"--store", store_, "--area", "floor"});
    return words;
  }

  TempDir folder_;
  World world_;
  std::string store_;
};

TEST_F(OutputTest, DryRunWritesNothing) {
  const std::string report = folder_.File("shift.report");
  RunForJson("shiftmap-localizer", OfMap({"run", "--report", report, world_.Log(1)}));
  const auto before = Contents(folder_.path());
  const std::string out = folder_.File("out.svg");
  const std::vector<std::pair<std::string, Arguments>> commands = {
      {"shiftmap-mapper", OfMap({"build", "--trajectories", out, world_.Log(1)})},
      {"shiftmap-mapper", OfMap({"import", folder_.File("survey.csv")})},
      {"shiftmap-mapper", {"import", "--store", out, "--area", "yard", folder_.File("survey.csv")}},
      {"shiftmap-localizer",
       OfMap({"run", "--return", "--report", out, "--trajectory", out + "2", world_.Log(1)})},
      {"shiftmap-localizer", {"return", "--store", store_, report}},
      {"shiftmap-inspect", OfMap({"plot", "--output", out})},
      {"shiftmap-inspect", OfMap({"export", "--csv", "--output", out})},
      {"shiftmap-inspect", OfMap({"export", "--snapshot", "--output", out})},
      {"shiftmap-sim", {"open", out, "--duration-s", "20"}},
      {"shiftmap-sim", {"mine", out, "--shifts", "1"}},
  };
  for (const auto& [program, words] : commands) {
    Arguments dry = words;
    dry.emplace_back("--dry-run");
    RunForJson(program, dry);
    EXPECT_TRUE(Contents(folder_.path()) == before) << program << " " << words.front();
  }
}

TEST_F(OutputTest, ADryRunRefusesASnapshotAsTheWriteDoes) {
  const std::string report = folder_.File("shift.report");
  RunForJson("shiftmap-localizer", OfMap({"run", "--report", report, world_.Log(1)}));
  const std::string snapshot = folder_.File("map.db");
  RunForJson("shiftmap-inspect", OfMap({"export", "--snapshot", "--output", snapshot}));
  const std::vector<std::pair<std::string, Arguments>> commands = {
      {"shiftmap-mapper", {"build", "--area", "floor", world_.Log(1)}},
      {"shiftmap-mapper", {"build", "--area", "floor", "--prior", "none", world_.Log(1)}},
      {"shiftmap-mapper", {"import", "--area", "floor", folder_.File("survey.csv")}},
      {"shiftmap-mapper", {"nightly", "--logs", folder_.path()}},
      {"shiftmap-localizer", {"return", report}},
      {"shiftmap-inspect", {"rollback", "--area", "floor"}},
  };
  for (auto [program, words] : commands) {
    words.insert(words.end(), {"--store", snapshot});
    ExpectError(program, words, kBadInput, "is a snapshot");
    words.emplace_back("--dry-run");
    ExpectError(program, words, kBadInput, "is a snapshot");
  }
}

TEST_F(OutputTest, ReadingLeavesTheStoreAsItIs) {
  RunForJson("shiftmap-mapper", OfMap({"build", world_.Log(1)}));
  const auto before = Contents(folder_.path());
  for (const char* list :
       {"versions", "show", "modes", "sightings", "runs", "reports", "vehicles"}) {
    RunForJson("shiftmap-inspect", OfMap({list}));
  }
  for (const char* list : {"areas", "audit", "verify"}) {
    RunForJson("shiftmap-inspect", {list, "--store", store_});
  }
  RunForJson("shiftmap-inspect", OfMap({"history", "L01"}));
  RunForJson("shiftmap-inspect", OfMap({"edit", "list"}));
  RunForJson("shiftmap-inspect", OfMap({"diff", "1", "2"}));
  const TempDir elsewhere;
  const std::vector<Arguments> pictures = {
      {"map"}, {"modes", "L01"}, {"history", "L01"}, {"diff", "1", "2"}, {"rates"}, {"night"}};
  for (Arguments words : pictures) {
    words.insert(words.begin(), "plot");
    words.insert(words.end(), {"--output", elsewhere.File("a.svg")});
    RunForJson("shiftmap-inspect", OfMap(words));
  }
  for (const char* form :
       {"--geojson", "--csv", "--g2o", "--textproto", "--protojson", "--snapshot", "--html"}) {
    RunForJson("shiftmap-inspect", OfMap({"export", form, "--output", elsewhere.File(form)}));
  }
  RunForJson("shiftmap-inspect", OfMap({"export", "--tum", "--output", elsewhere.File("tum")}));
  RunForJson("shiftmap-eval", OfMap({"map", world_.Places()}));
  RunForJson("shiftmap-localizer", OfMap({"run", world_.Log(1)}));
  EXPECT_TRUE(Contents(folder_.path()) == before);
}

TEST_F(OutputTest, FolderThatCannotBeWrittenToIsTemporary) {
  const std::string report = folder_.File("shift.report");
  RunForJson("shiftmap-localizer", OfMap({"run", "--report", report, world_.Log(1)}));
  const auto before = Contents(folder_.path());
  const CommandOptions nobody{.unprivileged = true};
  if (RunCommand("shiftmap-inspect", OfMap({"show"}), nobody).exit_code != 0) {
    GTEST_SKIP() << "another user cannot run the programs from here";
  }
  const std::string out = folder_.File("out.svg");
  const auto expect = [&](const std::string& program, const Arguments& words, const auto& object) {
    ExpectError(program, words, kTemporary, object, nobody);
  };
  expect("shiftmap-mapper", OfMap({"build", world_.Log(1)}), store_);
  expect("shiftmap-mapper", OfMap({"build", "--trajectories", out, world_.Log(1)}), out);
  expect("shiftmap-mapper", OfMap({"import", folder_.File("survey.csv")}), store_);
  expect("shiftmap-mapper",
         {"import", "--store", out, "--area", "yard", folder_.File("survey.csv")},
         out);
  expect("shiftmap-localizer", OfMap({"run", "--trajectory", out, world_.Log(1)}), out);
  expect("shiftmap-localizer", OfMap({"run", "--report", out, world_.Log(1)}), out);
  expect("shiftmap-localizer", OfMap({"run", "--return", world_.Log(1)}), store_);
  expect("shiftmap-localizer", {"return", "--store", store_, report}, store_);
  expect("shiftmap-inspect", OfMap({"plot", "--output", out}), out);
  expect("shiftmap-inspect", OfMap({"export", "--csv", "--output", out}), out);
  expect("shiftmap-inspect", OfMap({"export", "--snapshot", "--output", out}), out);
  expect("shiftmap-sim", {"open", out, "--duration-s", "20"}, out);
  expect("shiftmap-sim", {"mine", out, "--shifts", "1"}, out);
  EXPECT_TRUE(Contents(folder_.path()) == before);
}

TEST_F(OutputTest, FolderThatDoesNotExistIsNotFound) {
  constexpr int kNotFound = 6;
  const std::string out = folder_.File("no/such/file.svg");
  ExpectError(
      "shiftmap-localizer", OfMap({"run", "--trajectory", out, world_.Log(1)}), kNotFound, out);
  ExpectError("shiftmap-localizer", OfMap({"run", "--report", out, world_.Log(1)}), kNotFound, out);
  ExpectError("shiftmap-inspect", OfMap({"plot", "--output", out}), kNotFound, out);
  ExpectError("shiftmap-inspect", OfMap({"export", "--snapshot", "--output", out}), kNotFound, out);
  ExpectError("shiftmap-mapper",
              {"build", "--store", out, "--area", "floor", world_.Log(1)},
              kNotFound,
              out);
}

// Something else is there, and stays: trying again does not help.
TEST_F(OutputTest, FileInThePlaceOfAFolderIsBadInput) {
  const std::string file = folder_.File("survey.csv");
  const auto before = Contents(folder_.path());
  ExpectError("shiftmap-sim", {"open", file, "--duration-s", "20"}, kBadInput, file);
  ExpectError("shiftmap-sim", {"mine", file, "--shifts", "1"}, kBadInput, file);
  ExpectError(
      "shiftmap-mapper", OfMap({"build", "--trajectories", file, world_.Log(1)}), kBadInput, file);
  EXPECT_TRUE(Contents(folder_.path()) == before);
}

// What a vehicle has learned must not be lost to a full disk that nobody noticed.
TEST_F(OutputTest, FullDisk) {
  const CommandResult result =
      RunCommand("shiftmap-inspect", OfMap({"export", "--csv", "--output", "/dev/full"}));
  EXPECT_NE(result.exit_code, 0);
  EXPECT_EQ(CountLines(result.err), 1) << result.err;
}

TEST_F(OutputTest, TextAndJsonSayTheSame) {
  const CommandResult text = RunCommand("shiftmap-inspect", OfMap({"versions"}));
  const Json document = RunForJson("shiftmap-inspect", OfMap({"versions"}));
  EXPECT_EQ(text.exit_code, 0);
  EXPECT_EQ(text.err, "");
  const auto hash = document["versions"][0]["content_hash"].get<std::string>();
  EXPECT_NE(text.out.find(hash.substr(0, 12)), std::string::npos) << text.out;
}

}  // namespace
}  // namespace shiftmap::testing

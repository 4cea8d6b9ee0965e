// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/application.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <limits>
#include <new>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "mapstore/cli/version.h"
#include "mapstore/core/clock.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

// What a run left behind.
struct Outcome {
  int code;
  std::string out;
  std::string err;
};

// A program with a command `measure` that has options of several kinds, and one that writes.
struct Program {
  Program() : application("shiftmap-test", "A program for tests") {
    application
        .AddCommand("measure",
                    "Measure something",
                    [this](Context& context) {
                      ++calls;
                      quiet = context.quiet();
                      return body ? body(context) : OkStatus();
                    })
        .Option("FILE", &file, "A file")
        .Required()
        .Option("--max-range-m", &max_range_m, "A number")
        .InRange(0.0, 100.0)
        .Option("--max-height-m", &max_height_m, "An optional number")
        .Option("--seed", &seed, "A number from 0 on")
        .Time("--since", &since_s, "A time")
        .Option("--count", &count, "An optional integer")
        .Option("--tag", &tags, "A list")
        .Option("--kind", &kind, "A choice")
        .OneOf({"small", "large"})
        .Flag("--deep", &deep, "A flag")
        .Check([this] { return kind == "large" && deep ? "--deep is for --kind small" : ""; });
    application
        .AddCommand("store",
                    "Write something",
                    [this](Context& context) {
                      dry_run = context.dry_run();
                      if (!stored.empty()) context.Report({}, stored);
                      return OkStatus();
                    })
        .Writes();
  }

  Outcome Run(const std::vector<std::string>& arguments) {
    std::ostringstream out;
    std::ostringstream err;
    const ExitCode code = application.Run(arguments, &out, &err);
    return {static_cast<int>(code), out.str(), err.str()};
  }

  Application application;
  Command::Body body;
  int calls = 0;
  bool quiet = false;
  bool dry_run = false;
  std::string stored;
  std::string file;
  double max_range_m = 10.0;
  std::optional<double> max_height_m;
  std::uint64_t seed = 0;
  std::optional<std::int64_t> count;
  std::optional<double> since_s;
  std::vector<std::string> tags;
  std::string kind = "small";
  bool deep = false;
};

void ExpectUsageError(const Outcome& outcome, const std::string& text) {
  EXPECT_EQ(outcome.code, 2);
  EXPECT_EQ(outcome.out, "");
  EXPECT_THAT(outcome.err, StartsWith("shiftmap-test: "));
  EXPECT_THAT(outcome.err, HasSubstr(text));
  EXPECT_THAT(outcome.err, HasSubstr("--help'\n"));
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
}

TEST(Application, SetsOptionsAndRunsTheBody) {
  Program program;
  const Outcome outcome = program.Run({"measure",
                                       "a.mcap",
                                       "--max-range-m",
                                       "2.5",
                                       "--count=-7",
                                       "--tag",
                                       "x",
                                       "--tag",
                                       "y",
                                       "--deep",
                                       "--quiet"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(program.calls, 1);
  EXPECT_EQ(program.file, "a.mcap");
  EXPECT_EQ(program.max_range_m, 2.5);
  EXPECT_EQ(program.count, -7);
  EXPECT_THAT(program.tags, ::testing::ElementsAre("x", "y"));
  EXPECT_TRUE(program.deep);
  EXPECT_TRUE(program.quiet);
}

// `--kind=$KIND` with nothing in KIND.
TEST(Application, AnOptionWithoutItsValueDoesNotTakeTheNextWord) {
  Program program;
  ExpectUsageError(program.Run({"measure", "--tag=", "file"}), "--tag: expected a value after '='");
  EXPECT_EQ(program.calls, 0);
}

TEST(Application, AValueMayBeginWithADash) {
  Program program;
  const Outcome outcome = program.Run({"measure", "a", "--tag", "-loose", "--tag=--x"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(program.tags, ::testing::ElementsAre("-loose", "--x"));
}

TEST(Application, ATimeIsGivenAsADateOrBeforeNow) {
  Program date;
  EXPECT_EQ(date.Run({"measure", "a", "--since", "2026-01-09T06:00Z"}).code, 0);
  EXPECT_EQ(date.since_s, 1767938400.0);
  Program before;
  const double now_s = ToSecondsSinceEpoch(SystemNow());
  EXPECT_EQ(before.Run({"measure", "a", "--since", "-8h"}).code, 0);
  EXPECT_NEAR(before.since_s.value_or(0.0), now_s - 8.0 * 3600.0, 60.0);
  Program help;
  EXPECT_THAT(help.Run({"measure", "--help"}).out, HasSubstr("TIME (UTC): seconds since"));
}

TEST(Application, AListOptionLeavesThePositionalArgumentsAlone) {
  Program program;
  EXPECT_EQ(program.Run({"measure", "--tag", "x", "a.mcap"}).code, 0);
  EXPECT_EQ(program.file, "a.mcap");
}

TEST(Application, EveryCommandHasHelpAndVersion) {
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"--help"}, {"measure", "--help"}, {"store", "-h"}}) {
    Program program;
    const Outcome outcome = program.Run(arguments);
    EXPECT_EQ(outcome.code, 0);
    EXPECT_THAT(outcome.out, HasSubstr("Usage: shiftmap-test"));
    EXPECT_THAT(outcome.out, HasSubstr("--log-level"));
    EXPECT_THAT(outcome.out, HasSubstr("--config"));
    EXPECT_EQ(outcome.err, "");
  }
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"--version"}, {"measure", "--version"}}) {
    Program program;
    const Outcome outcome = program.Run(arguments);
    EXPECT_EQ(outcome.code, 0);
    EXPECT_EQ(outcome.out, "shiftmap-test " + SoftwareVersion() + "\n");
  }
}

TEST(Application, UsageErrorsAreOneLineWithAHint) {
  const std::pair<std::vector<std::string>, std::string> cases[] = {
      {{}, "required"},
      {{"fly"}, "unknown command 'fly';"},
      {{"mesure", "a"}, "unknown command 'mesure'; did you mean 'measure'? Try"},
      {{"measure"}, "FILE is required"},
      {{"measure", "a", "--nonsense"}, "no option '--nonsense';"},
      {{"measure", "--max-rang", "5"}, "no option '--max-rang'; did you mean '--max-range-m'?"},
      {{"measure", "a", "--tga=x"}, "no option '--tga'; did you mean '--tag'?"},
      {{"measure", "a", "-deep"}, "no option '-deep'; did you mean '--deep'?"},
      {{"measure", "a", "--since", "noon"}, "--since: 'noon' is no time; expected one of: seconds"},
      {{"measure", "a", "--max-range-m", "far"}, "--max-range-m"},
      {{"measure", "a", "--max-range-m", "101"}, "--max-range-m"},
      {{"measure", "a", "--max-range-m", "nan"}, "--max-range-m: Value nan is not finite"},
      {{"measure", "a", "--max-height-m", "inf"}, "--max-height-m: Value inf is not finite"},
      {{"measure", "a", "--seed", "-1"}, "--seed: Value -1 is negative"},
      {{"measure", "a", "--seed", "one"}, "--seed: 'one' is no number;"},
      {{"measure", "a", "--count", "two"}, "--count: 'two' is no number;"},
      {{"measure", "a", "--count", "1.5"}, "--count: '1.5' is no integer in range;"},
      {{"measure", "a", "--count", "0x10"}, "--count: '0x10' is no number;"},
      {{"measure", "a", "--count", "9223372036854775808"},
       "--count: '9223372036854775808' is no integer in range;"},
      {{"measure", "a", "--max-height-m", "high"}, "--max-height-m: 'high' is no number;"},
      {{"measure", "a", "--kind", "lrage"},
       "--kind: 'lrage' is none of small, large; did you mean 'large'?"},
      {{"measure", "a", "--kind", "large", "--deep"}, "--deep is for --kind small"},
      {{"measure", "a", "--log-level", "wraning"}, "did you mean 'warning'?"},
      {{"measure", "a", "--dry-run"}, "--dry-run"},
  };
  for (const auto& [arguments, text] : cases) {
    Program program;
    ExpectUsageError(program.Run(arguments), text);
    EXPECT_EQ(program.calls, 0);
  }
}

TEST(Application, AnActionThatWritesIsNotRepeated) {
  Application application("shiftmap-test", "");
  std::string action = "list";
  int calls = 0;
  application
      .AddCommand("runs",
                  "",
                  [&](Context&) {
                    ++calls;
                    return NotFound("no area");  // Ends the repetitions.
                  })
      .Option("ACTION", &action, "What to do")
      .Watchable([&] { return action == "list"; })
      .Writes();
  std::ostringstream out;
  std::ostringstream err;
  EXPECT_EQ(application.Run({"runs", "--watch", "1"}, &out, &err), ExitCode::kNotFound);
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(application.Run({"runs", "exclude", "--watch", "1"}, &out, &err), ExitCode::kUsage);
  EXPECT_THAT(err.str(), HasSubstr("--watch is for an action that only looks"));
  EXPECT_EQ(calls, 1);
}

TEST(Application, OnlyACommandThatWritesHasDryRun) {
  Program program;
  EXPECT_EQ(program.Run({"store", "--dry-run"}).code, 0);
  EXPECT_TRUE(program.dry_run);
}

TEST(Application, AnErrorIsOneLineAndItsExitCode) {
  Program program;
  program.body = [](Context&) { return NotFound("map store 'a.db': no\nsuch file"); };
  const Outcome outcome = program.Run({"measure", "a"});
  EXPECT_EQ(outcome.code, 6);
  EXPECT_EQ(outcome.out, "");
  EXPECT_EQ(outcome.err, "shiftmap-test: map store 'a.db': no\\nsuch file\n");
}

TEST(Application, AnErrorWithJsonIsADocument) {
  Program program;
  program.body = [](Context&) { return DataLoss("broken"); };
  const Outcome outcome = program.Run({"measure", "a", "--json"});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_EQ(Json::parse(outcome.out), Json({{"error", "broken"}, {"exit_code", 3}}));
}

TEST(Application, ReportsTextOrOneDocument) {
  const auto body = [](Context& context) {
    context.Report({{"answer", 42}}, "the answer is 42\n");
    return OkStatus();
  };
  Program text;
  text.body = body;
  EXPECT_EQ(text.Run({"measure", "a"}).out, "the answer is 42\n");
  Program json;
  json.body = body;
  EXPECT_EQ(Json::parse(json.Run({"measure", "a", "--json"}).out), Json({{"answer", 42}}));
  Program before;
  before.body = body;
  EXPECT_EQ(Json::parse(before.Run({"--json", "measure", "a"}).out), Json({{"answer", 42}}));
}

TEST(Application, ABodyMayReportAndStillSayThatThereWasNothingToDo) {
  Program program;
  program.body = [](Context& context) {
    context.Report({{"duplicate", true}}, "");
    return Status(StatusCode::kAlreadyExists, "nothing to do");
  };
  const Outcome outcome = program.Run({"measure", "a", "--json"});
  EXPECT_EQ(outcome.code, 5);
  EXPECT_EQ(Json::parse(outcome.out), Json({{"duplicate", true}}));
}

TEST(Application, ExceptionsBecomeInternalErrors) {
  Program thrown;
  thrown.body = [](Context&) -> Status { throw std::runtime_error("oops"); };
  const Outcome outcome = thrown.Run({"measure", "a"});
  EXPECT_EQ(outcome.code, 70);
  EXPECT_THAT(outcome.err, HasSubstr("oops"));
  Program memory;
  memory.body = [](Context&) -> Status { throw std::bad_alloc(); };
  EXPECT_EQ(memory.Run({"measure", "a"}).code, 70);
}

TEST(Application, AnOutputIsAFileOfItsOwn) {
  std::string output;
  Program program;
  program.application.AddCommand("copy", "Copy a file", [](Context&) { return OkStatus(); })
      .Option("FILE", &program.file, "A file")
      .Option("--output", &output, "A file to write")
      .Output();
  EXPECT_EQ(program.Run({"copy", "-", "--output", "a"}).code, 0);
  ExpectUsageError(program.Run({"copy", "a", "--output", "-"}),
                   "--output '-': expected the name of a file");
  const testing::TempDir folder;
  const std::string path = folder.File("a");
  std::ofstream(path) << "a";
  ExpectUsageError(program.Run({"copy", path, "--output", path}), "is the file of FILE");
}

TEST(Application, AFullStandardOutputIsAnError) {
  Program program;
  program.body = [](Context& context) {
    context.Report({}, "text");
    return OkStatus();
  };
  std::ostringstream out;
  out.setstate(std::ios::badbit);
  std::ostringstream err;
  EXPECT_EQ(program.application.Run({"measure", "a"}, &out, &err), ExitCode::kTemporary);
}

TEST(Application, AWriteWhoseOutputIsLostIsDoneAndSaysSo) {
  Program program;
  program.stored = "version 3, content abc\nmore\n";
  std::ostringstream out;
  out.setstate(std::ios::badbit);
  for (const bool json : {false, true}) {
    std::ostringstream err;
    std::vector<std::string> words = {"store"};
    if (json) words.emplace_back("--json");
    Program run;
    run.stored = program.stored;
    EXPECT_EQ(run.application.Run(words, &out, &err), ExitCode::kAttention);
    EXPECT_EQ(err.str(),
              "shiftmap-test: standard output: cannot be written, but it is done: version 3, "
              "content abc\n");
  }
  std::ostringstream err;
  EXPECT_EQ(program.application.Run({"store", "--dry-run"}, &out, &err), ExitCode::kTemporary);
}

// As of a message to a service: the command writes no file, and must not be sent twice.
TEST(Application, AnEffectWhoseOutputIsLostIsDoneToo) {
  Program program;
  program.body = [](Context& context) {
    context.NoteEffect();
    context.Report({}, "stopped");
    return OkStatus();
  };
  std::ostringstream out;
  out.setstate(std::ios::badbit);
  std::ostringstream err;
  EXPECT_EQ(program.application.Run({"measure", "a"}, &out, &err), ExitCode::kAttention);
}

TEST(Application, ALostOutputDoesNotHideAnError) {
  Program program;
  program.body = [](Context&) { return NotFound("no such thing"); };
  std::ostringstream out;
  out.setstate(std::ios::badbit);
  std::ostringstream err;
  EXPECT_EQ(program.application.Run({"measure", "a", "--json"}, &out, &err), ExitCode::kNotFound);
  EXPECT_EQ(err.str(), "shiftmap-test: no such thing\n");
}

TEST(Application, WhatAPersonShouldSeeHasItsExitCode) {
  Program program;
  program.body = [](Context& context) {
    context.Attend("one log is left out");
    return OkStatus();
  };
  const Outcome outcome = program.Run({"measure", "a"});
  EXPECT_EQ(outcome.code, 8);
  EXPECT_EQ(outcome.err, "shiftmap-test: warning: one log is left out\n");
  const Outcome quiet = program.Run({"measure", "a", "--quiet"});
  EXPECT_EQ(quiet.code, 8);
  EXPECT_EQ(quiet.err, "shiftmap-test: error: one log is left out\n");
}

TEST(Application, WarnsOfTheSameOnceIfACommandSaysSo) {
  Program program;
  program.body = [](Context& context) {
    context.Warn("again");
    context.Warn("again");
    for (int i = 0; i < 2; ++i) {
      context.SayEachOnce();
      context.Warn("once");
      context.Inform("once, too");
      context.Warn("another");
    }
    context.Report({}, "");
    return OkStatus();
  };
  EXPECT_EQ(program.Run({"measure", "a"}).err,
            "shiftmap-test: warning: again\nshiftmap-test: warning: again\n"
            "shiftmap-test: warning: once\nshiftmap-test: info: once, too\n"
            "shiftmap-test: warning: another\n");
}

// Nothing that a name holds moves the cursor or begins a line.
TEST(Application, WhatIsPrintedIsInert) {
  const std::string hostile =
      "a\x1b[1A\x1b[2K\x07\r\n\tb\xc2\x9b"
      "c\xe2\x80\xae"
      "d\x7f\xff";
  const std::string line = "a\\x1b[1A\\x1b[2K\\x07\\r\\n\\tb\\u009bc\\u202ed\\u007f\\xff";
  Program error;
  error.body = [&](Context& context) {
    context.Warn(hostile);
    return InvalidArgument("vehicle '{}'", hostile);
  };
  EXPECT_EQ(error.Run({"measure", "a"}).err,
            "shiftmap-test: warning: " + line + "\nshiftmap-test: vehicle '" + line + "'\n");
  Program usage;
  ExpectUsageError(usage.Run({"measure", "a", "--kind", hostile}), line);
  Program report;
  report.body = [&](Context& context) {
    context.Report({{"name", hostile}}, "name " + hostile + "\n");
    return OkStatus();
  };
  EXPECT_EQ(report.Run({"measure", "a"}).out,
            "name a\\x1b[1A\\x1b[2K\\x07\\r\n\\tb\\u009bc\\u202ed\\u007f\\xff\n");
}

TEST(Application, JsonIsInertAndKeepsTheValues) {
  Program program;
  const std::string name = "a\x1b[2K\x7f\xc2\x9b\xe2\x80\xae\nü";
  program.body = [&](Context& context) {
    context.Report({{"name", name}}, "");
    return OkStatus();
  };
  const Outcome outcome = program.Run({"measure", "a", "--json"});
  EXPECT_EQ(Json::parse(outcome.out)["name"], name);
  EXPECT_THAT(outcome.out, HasSubstr("ü"));
  for (const char* active : {"\x1b", "\x7f", "\xc2\x9b", "\xe2\x80\xae"}) {
    EXPECT_THAT(outcome.out, Not(HasSubstr(active)));
  }
}

TEST(Application, AListTakesSeveralValuesWhereNoPositionalArgumentFollows) {
  Application application("shiftmap-lists", "");
  std::vector<std::string> methods;
  std::vector<std::string> sets;
  bool quick = false;
  application.AddCommand("run", "", [](Context&) { return OkStatus(); })
      .Option("--methods", &methods, "A list")
      .Option("--sets", &sets, "Another")
      .Flag("--quick", &quick, "A flag");
  std::ostringstream out;
  std::ostringstream err;
  EXPECT_EQ(
      application.Run(
          {"run", "--methods", "a", "b", "--quick", "--sets", "1", "--sets", "2"}, &out, &err),
      ExitCode::kDone)
      << err.str();
  EXPECT_THAT(methods, ::testing::ElementsAre("a", "b"));
  EXPECT_THAT(sets, ::testing::ElementsAre("1", "2"));
  EXPECT_TRUE(quick);
}

TEST(Application, AProgramMayDoOneThing) {
  Application application("shiftmap-one", "One thing");
  std::string store;
  application.AddCommand("", "", [](Context&) { return OkStatus(); })
      .Option("--store", &store, "A store")
      .Required();
  std::ostringstream out;
  std::ostringstream err;
  EXPECT_EQ(application.Run({"--store", "a.db"}, &out, &err), ExitCode::kDone) << err.str();
  EXPECT_EQ(store, "a.db");
}

class ApplicationConfig : public ::testing::Test {
 protected:
  Outcome Run(Program* program, const std::string& toml, std::vector<std::string> arguments) {
    const std::string path = dir_.File("options.toml");
    testing::WriteFile(path, toml);
    arguments.insert(arguments.end(), {"--config", path});
    return program->Run(arguments);
  }

  testing::TempDir dir_;
};

TEST_F(ApplicationConfig, SetsOptions) {
  Program program;
  const Outcome outcome = Run(&program,
                              "max_range_m = 7.5\n[measure]\ncount = 3\ntag = ['a', 'b']\n"
                              "deep = true\n",
                              {"measure", "x"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(program.max_range_m, 7.5);
  EXPECT_EQ(program.count, 3);
  EXPECT_THAT(program.tags, ::testing::ElementsAre("a", "b"));
  EXPECT_TRUE(program.deep);
}

TEST_F(ApplicationConfig, TheCommandLineWins) {
  Program program;
  EXPECT_EQ(Run(&program, "max-range-m = 7.5\n", {"measure", "x", "--max-range-m", "5"}).code, 0);
  EXPECT_EQ(program.max_range_m, 5.0);
}

TEST_F(ApplicationConfig, AnUnknownKeyIsAUsageErrorThatNamesIt) {
  Program top;
  ExpectUsageError(Run(&top, "max_rnage_m = 7.5\n", {"measure", "x"}), "max-rnage-m");
  Program section;
  ExpectUsageError(Run(&section, "[measure]\nsize = 1\n", {"measure", "x"}), "measure.size");
  Program table;
  ExpectUsageError(Run(&table, "[other]\ncount = 1\n", {"measure", "x"}), "unknown table 'other'");
}

TEST_F(ApplicationConfig, AnEmptyValueDoesNotTakeAWordOfTheCommandLine) {
  Program program;
  const Outcome outcome = Run(&program, "[measure]\ntag = ''\n", {"measure", "x"});
  ExpectUsageError(outcome, "tag: expected a value");
  EXPECT_EQ(program.calls, 0);
}

TEST_F(ApplicationConfig, OnlyARegularFileOfSensibleSizeIsRead) {
  ASSERT_EQ(mkfifo(dir_.File("fifo").c_str(), 0600), 0);
  testing::WriteFile(dir_.File("large"), std::string((1U << 20) + 1, '\n'));
  for (const std::string& path : {dir_.path(),
                                  dir_.File("fifo"),
                                  dir_.File("large"),
                                  std::string("/dev/zero"),
                                  std::string("/proc/self/mem")}) {
    Program program;
    ExpectUsageError(program.Run({"measure", "x", "--config", path}), "config '" + path + "': ");
    EXPECT_EQ(program.calls, 0);
  }
}

TEST_F(ApplicationConfig, AFileThatIsNotTomlIsAUsageError) {
  Program broken;
  ExpectUsageError(Run(&broken, "count = = 1\n", {"measure", "x"}), "options.toml:1");
  Program nested;
  ExpectUsageError(Run(&nested, "[measure]\ncount = {a = 1}\n", {"measure", "x"}), "count");
  Program missing;
  ExpectUsageError(missing.Run({"measure", "x", "--config", dir_.File("none.toml")}),
                   "does not exist");
}

TEST(JsonText, NumbersSurviveARoundTrip) {
  for (const double value : {0.1,
                             1.0 / 3.0,
                             1e-300,
                             1767600000.123456,
                             -0.0,
                             std::numeric_limits<double>::denorm_min()}) {
    const Json document = {{"value", value}};
    EXPECT_EQ(Json::parse(JsonText(document))["value"].get<double>(), value);
  }
}

TEST(JsonText, BytesThatAreNotUtf8AreReplaced) {
  EXPECT_NO_THROW(Json::parse(JsonText({{"name", "\xff\xfe"}})));
}

}  // namespace
}  // namespace shiftmap

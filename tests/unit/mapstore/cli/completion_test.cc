// SPDX-License-Identifier: Apache-2.0
//
// The scripts are run by the shells that they are for.
#include "mapstore/cli/internal/completion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <sstream>

#include "mapstore/cli/application.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::IsSupersetOf;
using ::testing::Not;

// A program with two commands, and its completion scripts in files.
class Completion : public ::testing::Test {
 protected:
  Completion() {
    application_.AddCommand("plot", "Draw 'it': [a picture]", [](Context&) { return OkStatus(); })
        .Option("WHAT", &what_, "The picture")
        .OneOf({"map", "night"})
        .Option("--output", &output_, "A file")
        .Option("--theme", &theme_, "A choice")
        .OneOf({"dark", "light"})
        .Flag("--deep", &deep_, "A flag");
    application_.AddCommand("list", "List it", [](Context&) { return OkStatus(); });
    for (const std::string shell : {"bash", "zsh"}) {
      std::ostringstream out;
      std::ostringstream err;
      EXPECT_EQ(application_.Run({"--completion", shell}, &out, &err), ExitCode::kDone);
      testing::WriteFile(dir_.File(shell), out.str());
    }
  }

  std::vector<std::string> Run(const std::string& shell, const std::string& script) {
    const std::string path = dir_.File("script");
    testing::WriteFile(path, script);
    std::FILE* const pipe = popen((shell + " " + path + " 2>&1").c_str(), "r");
    std::string text;
    std::array<char, 4096> buffer;
    while (const std::size_t got = std::fread(buffer.data(), 1, buffer.size(), pipe)) {
      text.append(buffer.data(), got);
    }
    EXPECT_EQ(pclose(pipe), 0) << text;
    std::vector<std::string> lines;
    std::istringstream stream(text);
    for (std::string line; std::getline(stream, line);) {
      if (!line.empty()) lines.push_back(line);
    }
    return lines;
  }

  // What bash offers for the last word.
  std::vector<std::string> Bash(const std::string& words) {
    return Run("bash",
               "set -eu; source " + dir_.File("bash") + "; COMP_WORDS=(" + words +
                   "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _shiftmap_test; "
                   "printf '%s\\n' \"${COMPREPLY[@]}\"");
  }

  // What zsh's own functions are called with for the last word.
  std::vector<std::string> Zsh(const std::string& words) {
    return Run("zsh -f",
               "_arguments() { print -rl -- \"$@\" }\n"
               "_describe() { print -rl -- \"${commands[@]}\" }\n"
               "complete() { source " +
                   dir_.File("zsh") + " }\nwords=(" + words + ")\nCURRENT=${#words}\ncomplete\n");
  }

  testing::TempDir dir_;
  Application application_{"shiftmap-test", "A program for tests"};
  std::string what_;
  std::string output_;
  std::string theme_ = "dark";
  bool deep_ = false;
};

TEST_F(Completion, BashOffersCommandsBeforeACommand) {
  EXPECT_THAT(Bash("shiftmap-test ''"), IsSupersetOf({"plot", "list", "--version"}));
  EXPECT_THAT(Bash("shiftmap-test pl"), ElementsAre("plot"));
}

TEST_F(Completion, BashOffersOptionsAndValuesOfTheCommand) {
  EXPECT_THAT(Bash("shiftmap-test plot ''"),
              AllOf(IsSupersetOf({"map", "night", "--output", "--theme", "--deep", "--json"}),
                    Not(Contains("list"))));
  EXPECT_THAT(Bash("shiftmap-test list ''"), Not(Contains("--theme")));
  EXPECT_THAT(Bash("shiftmap-test plot --theme ''"), ElementsAre("dark", "light"));
  EXPECT_THAT(Bash("shiftmap-test plot --log-level w"), ElementsAre("warning"));
}

TEST_F(Completion, BashLeavesFilesToItself) {
  EXPECT_THAT(Bash("shiftmap-test plot --output ''"), IsEmpty());
}

TEST_F(Completion, ZshOffersCommandsWithTheirDescriptions) {
  EXPECT_THAT(Zsh("shiftmap-test ''"),
              AllOf(Contains("plot:Draw 'it'\\: \\[a picture\\]"), Contains("list:List it")));
}

TEST_F(Completion, ZshOffersOptionsAndValuesOfTheCommand) {
  EXPECT_THAT(Zsh("shiftmap-test plot ''"),
              IsSupersetOf({"*--theme[A choice]:value:(dark light)",
                            "*--output[A file]:value:_files",
                            "*--deep[A flag]",
                            "*:The picture:(map night)"}));
  EXPECT_THAT(Zsh("shiftmap-test list ''"), Not(Contains(HasSubstr("--theme"))));
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/internal/watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <sstream>

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

// Writes a line each time, and interrupts the third.
struct Source {
  ExitCode operator()(std::ostream* out) {
    *out << "line " << ++calls << "\nsecond\nthird\nfourth\n";
    if (calls == 3) std::raise(SIGINT);
    return code;
  }
  int calls = 0;
  ExitCode code = ExitCode::kDone;
};

TEST(Watch, AppendsElsewhereAndEndsOnAnInterrupt) {
  Source source;
  std::ostringstream out;
  EXPECT_EQ(Watch(0.001, {}, &out, std::ref(source)), ExitCode::kDone);
  EXPECT_EQ(source.calls, 3);
  EXPECT_EQ(out.str(),
            "line 1\nsecond\nthird\nfourth\nline 2\nsecond\nthird\nfourth\n"
            "line 3\nsecond\nthird\nfourth\n");
}

TEST(Watch, RedrawsATerminalWithinItsHeight) {
  Source source;
  std::ostringstream out;
  EXPECT_EQ(Watch(0.001, {.columns = 80, .rows = 5, .colour = false}, &out, std::ref(source)),
            ExitCode::kDone);
  EXPECT_THAT(out.str(), StartsWith("\033[H\033[2J"));
  EXPECT_THAT(out.str(), HasSubstr("line 3\nsecond\n… 2 more lines"));
}

TEST(Watch, AnErrorThatMayPassIsWaitedOutAndAnotherEndsIt) {
  Source busy{.code = ExitCode::kTemporary};
  std::ostringstream out;
  EXPECT_EQ(Watch(0.001, {}, &out, std::ref(busy)), ExitCode::kDone);
  EXPECT_EQ(busy.calls, 3);
  Source missing{.code = ExitCode::kNotFound};
  EXPECT_EQ(Watch(0.001, {}, &out, std::ref(missing)), ExitCode::kNotFound);
  EXPECT_EQ(missing.calls, 1);
}

}  // namespace
}  // namespace shiftmap

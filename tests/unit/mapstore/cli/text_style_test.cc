// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/text_style.h"

#include <gtest/gtest.h>

#include "mapstore/cli/aligned_table.h"

namespace shiftmap {
namespace {

TEST(TextStyle, MarksAreColourOnlyWhereThatIsWanted) {
  const std::string text = "a " + Marked("b", Emphasis::kAlarm) + "\n";
  EXPECT_EQ(RenderMarks(text, /*colour=*/false), "a b\n");
  EXPECT_EQ(RenderMarks(text, /*colour=*/true), "a \033[31mb\033[0m\n");
  EXPECT_EQ(DisplayWidth(Marked("µm", Emphasis::kStrong)), 2U);
}

TEST(TextStyle, ANameCannotBringAnEscapeSequence) {
  EXPECT_EQ(RenderMarks("\033[31mred", /*colour=*/true), "\\x1b[31mred");
}

TEST(TextStyle, ShortenedTextsKeepWholeCharacters) {
  EXPECT_EQ(Shortened("übermäßig", 9), "übermäßig");
  EXPECT_EQ(Shortened("übermäßig", 4), "übe…");
  EXPECT_EQ(Shortened("ab", 1), "…");
  EXPECT_EQ(Shortened("ab", 0), "");
}

TEST(AlignedTable, FitsTheTerminalByItsWidestColumnOfText) {
  AlignedTable table({"name", "reason", "count"});
  table.AddRow({"L07", "made against a version of another line", "12"});
  table.AddRow({"L08", "short", "3"});
  EXPECT_EQ(RenderMarks(table.ToString({.columns = 30, .rows = 0, .colour = false}), false),
            "name  reason             count\n"
            "L07   made against a v…     12\n"
            "L08   short                  3\n");
  const std::string whole = table.ToString();
  EXPECT_NE(whole.find("made against a version of another line"), std::string::npos);
}

TEST(AlignedTable, TheLastColumnsAreLeftOutWhereNoTextIsLeftToShorten) {
  AlignedTable table({"alpha", "beta", "gamma"});
  table.AddRow({"100000", "200000", "300000"});
  EXPECT_EQ(table.ToString({.columns = 17, .rows = 0, .colour = false}),
            " alpha    beta  …\n100000  200000  …\n");
  EXPECT_EQ(table.ToString({.columns = 4, .rows = 0, .colour = false}), " al…\n100…\n");
}

TEST(AlignedTable, TimesAreNotShortened) {
  AlignedTable table({"begin", "reason"});
  table.AddRow({"2026-01-09 06:00:00", "another report about its run counts"});
  EXPECT_EQ(table.ToString({.columns = 40, .rows = 0, .colour = false}),
            "begin                reason\n2026-01-09 06:00:00  another report abo…\n");
}

}  // namespace
}  // namespace shiftmap

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

TEST(TextStyle, LinesAreBrokenAtBlanks) {
  EXPECT_EQ(Wrapped("one two three four\nfive\n", 9), "one two\n  three\n  four\nfive\n");
  EXPECT_EQ(Wrapped("one two three four\n", 0), "one two three four\n");
  EXPECT_EQ(Wrapped("  indented and longer", 12), "  indented\n  and longer");
  EXPECT_EQ(Wrapped("sha256 0123456789abcdef end\n", 8), "sha256\n  0123456789abcdef\n  end\n");
  // Marks take no column, and a character of several bytes takes one.
  const std::string marked = Marked("größer", Emphasis::kAlarm) + " als\n";
  EXPECT_EQ(Wrapped(marked, 10), marked);
}

TEST(AlignedTable, TheLastColumnsAreNamedWhereTheyDoNotFit) {
  AlignedTable table({"alpha", "beta", "gamma", "delta"});
  table.AddRow({"100000", "200000", "300000", "400000"});
  EXPECT_EQ(table.ToString({.columns = 17, .rows = 0, .colour = false}),
            " alpha    beta\n100000  200000\n"
            "not shown: gamma,\n  delta (| less\n  -S shows all)\n");
  const std::string narrow = table.ToString({.columns = 4, .rows = 0, .colour = false});
  EXPECT_EQ(narrow.substr(0, narrow.find("not")), " al…\n100…\n");
  EXPECT_EQ(table.ToString({.columns = 30, .rows = 0, .colour = false}).find("not"),
            std::string::npos);
}

// Whoever asks why reads the reason, before what is less important gets room.
TEST(AlignedTable, TextStaysReadableAndTheLastColumnThatFitsIsNarrower) {
  AlignedTable table({"state", "reason", "author"});
  table.AddRow({"excluded by an operator", "the lidar was dirty that day", "somebody else"});
  const TextStyle style = {.columns = 48, .rows = 0, .colour = false};
  EXPECT_EQ(table.ToString(style),
            "state             reason            author\n"
            "excluded by an …  the lidar was d…  somebody el…\n");
  table.KeepWide(1, 24);
  EXPECT_EQ(table.ToString(style),
            "state                    reason\n"
            "excluded by an operator  the lidar was dirty th…\n"
            "not shown: author (| less -S shows all)\n");
}

TEST(AlignedTable, TimesAreNotShortened) {
  AlignedTable table({"begin", "reason"});
  table.AddRow({"2026-01-09 06:00:00", "another report about its run counts"});
  EXPECT_EQ(table.ToString({.columns = 40, .rows = 0, .colour = false}),
            "begin                reason\n2026-01-09 06:00:00  another report abo…\n");
}

}  // namespace
}  // namespace shiftmap

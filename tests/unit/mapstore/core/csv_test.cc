// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/csv.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::StatusIs;
using Cells = std::vector<std::string>;

std::vector<Cells> Parse(std::string_view text) {
  const StatusOr<std::vector<CsvRecord>> records = ParseCsv(text);
  EXPECT_TRUE(records.ok()) << Message(records.status());
  std::vector<Cells> cells;
  if (records.ok()) {
    for (const CsvRecord& record : *records) cells.push_back(record.cells);
  }
  return cells;
}

TEST(Csv, CellsLinesAndComments) {
  EXPECT_EQ(Parse("a,b\n1,2\n"), (std::vector<Cells>{{"a", "b"}, {"1", "2"}}));
  EXPECT_EQ(Parse("a,b\r\n,2\r\n"), (std::vector<Cells>{{"a", "b"}, {"", "2"}}));
  EXPECT_EQ(Parse("\xef\xbb\xbf"
                  "a\n\n# b,\"\n\r\nc,"),
            (std::vector<Cells>{{"a"}, {"c", ""}}));
  EXPECT_TRUE(Parse("").empty());
}

TEST(Csv, QuotedCells) {
  EXPECT_EQ(Parse("\"a\"\"b\",\"c,d\"\n\"#\",\"\"\n"),
            (std::vector<Cells>{{"a\"b", "c,d"}, {"#", ""}}));
  const auto records = ParseCsv("a\n\"b\nc\r\n\",d\ne\n");
  ASSERT_TRUE(records.ok());
  ASSERT_EQ(records->size(), 3U);
  EXPECT_EQ((*records)[1].cells, (Cells{"b\nc\r\n", "d"}));
  EXPECT_EQ((*records)[1].line, 2);
  EXPECT_EQ((*records)[2].line, 5);
}

TEST(Csv, BadQuotesAreNamedByLine) {
  EXPECT_THAT(ParseCsv("a\n\"b"), StatusIs(StatusCode::kInvalidArgument, "line 2: a quote that"));
  EXPECT_THAT(ParseCsv("a\nb\"c\n"), StatusIs(StatusCode::kInvalidArgument, "line 2: a quote in"));
  EXPECT_THAT(ParseCsv("\"a\"b\n"), StatusIs(StatusCode::kInvalidArgument, "line 1: text behind"));
}

TEST(Csv, TextsThatASpreadsheetComputesGetAnApostrophe) {
  for (const char* text : {"=cmd()", "+1+1", "-2", "@SUM(A1)", "\tx", "'=1", "''@"}) {
    EXPECT_EQ(CsvText(text), std::string("'") + text);
    EXPECT_EQ(TextOfCsv(std::string("'") + text), text);
  }
  EXPECT_EQ(TextOfCsv("'\r=1"), "\r=1");
  for (const char* text : {"L07", "'quoted'", "'", "1=2", "a-b", ""}) {
    EXPECT_EQ(CsvText(text), text);
    EXPECT_EQ(TextOfCsv(text), text);
  }
}

TEST(Csv, WhatATerminalWouldObeyIsEscaped) {
  const std::pair<std::string, std::string> cases[] = {{"\x1b[2Ja", "\\x1b[2Ja"},
                                                       {"\a", "\\x07"},
                                                       {"a\rb", "a\\x0db"},
                                                       {"\u009b1A", "\\u009b1A"},
                                                       {"\u202etxt", "\\u202etxt"},
                                                       {"\xff", "\\xff"},
                                                       {"a\\x1b", "a\\\\x1b"},
                                                       {"C:\\temp", "C:\\\\temp"},
                                                       {"Größe\t1", "Größe\t1"}};
  for (const auto& [text, cell] : cases) {
    EXPECT_EQ(CsvText(text), cell);
    EXPECT_EQ(TextOfCsv(cell), text);
  }
  // As somebody writes it by hand.
  for (const char* text : {"C:\\temp", "\\", "a\\xyz", "\\u12"}) EXPECT_EQ(TextOfCsv(text), text);
}

TEST(Csv, EveryTextSurvivesTheRoundTrip) {
  std::mt19937_64 random(testing::TestSeed(6));
  const std::string alphabet("=+-@'\"#,\r\n\t ;ab\0\xc3\\x1u\x1b\xc2\x9b", 25);
  for (int round = 0; round < 5000; ++round) {
    std::vector<Cells> rows(1 + random() % 3);
    std::string text;
    for (Cells& row : rows) {
      row.emplace_back("x");  // A record of one empty cell is an empty line.
      for (int i = static_cast<int>(random() % 3); i >= 0; --i) {
        std::string& cell = row.emplace_back(random() % 6, ' ');
        for (char& c : cell) c = alphabet[random() % alphabet.size()];
      }
      std::swap(row.front(), row.back());
      if (row.front().empty()) row.front() = "#";
      for (std::size_t i = 0; i < row.size(); ++i) {
        const std::string written = CsvText(row[i]);
        ASSERT_TRUE(written.find_first_of("=+-@\t\r") != 0) << written;
        text += (i > 0 ? "," : "") + written;
      }
      text += round % 2 == 0 ? "\n" : "\r\n";
    }
    std::vector<Cells> back = Parse(text);
    for (Cells& row : back) {
      for (std::string& cell : row) cell = TextOfCsv(cell);
    }
    ASSERT_EQ(back, rows) << text;
  }
}

}  // namespace
}  // namespace shiftmap

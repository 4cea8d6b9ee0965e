// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/aligned_table.h"

#include <gtest/gtest.h>

namespace shiftmap {
namespace {

TEST(AlignedTable, AlignsNumbersToTheRightAndTextToTheLeft) {
  AlignedTable table({"name", "x_m"});
  table.AddRow({"a", "-1.5"});
  table.AddRow({"long name", "10.25"});
  table.AddRow({"b", "-"});
  EXPECT_EQ(table.ToString(),
            "name         x_m\n"
            "a           -1.5\n"
            "long name  10.25\n"
            "b              -\n");
}

TEST(AlignedTable, CountsCharactersNotBytes) {
  AlignedTable table({"name", "unit"});
  table.AddRow({"Größe", "m"});
  table.AddRow({"width", "m"});
  EXPECT_EQ(table.ToString(), "name   unit\nGröße  m\nwidth  m\n");
}

TEST(AlignedTable, AHeaderAlone) { EXPECT_EQ(AlignedTable({"a", "b"}).ToString(), "a  b\n"); }

TEST(AlignedTable, ARowIsALineWhateverItsCellsHold) {
  AlignedTable table({"vehicle", "rows"});
  table.AddRow({"\x1b[1A\x1b[2K\n2026-01-09 honest\r", "7"});
  EXPECT_EQ(table.ToString(),
            "vehicle                              rows\n"
            "\\x1b[1A\\x1b[2K\\n2026-01-09 honest\\r     7\n");
}

}  // namespace
}  // namespace shiftmap

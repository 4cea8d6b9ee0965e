// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/result_table.h"

#include <gtest/gtest.h>

#include <limits>

namespace shiftmap {
namespace {

TEST(ResultTable, IsCsvWithQuotesWhereNeeded) {
  ResultTable table({"name", "value"});
  table.AddRow({"plain", 0.25});
  table.AddRow({"a,b", 1e6});
  table.AddRow({"say \"no\"", std::numeric_limits<double>::quiet_NaN()});
  EXPECT_EQ(table.ToCsv(), "name,value\nplain,0.25\n\"a,b\",1e+06\n\"say \"\"no\"\"\",\n");
}

TEST(ResultTable, WithoutRowsIsAHeader) { EXPECT_EQ(ResultTable({"a", "b"}).ToCsv(), "a,b\n"); }

TEST(ResultTable, IsATextForPeople) {
  ResultTable table({"name", "value"});
  table.AddRow({"x", 2.0});
  EXPECT_NE(table.ToText().find("name"), std::string::npos);
  EXPECT_NE(table.ToText().find('2'), std::string::npos);
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/chart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

int Count(const std::string& text, const std::string& what) {
  int count = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) {
    ++count;
  }
  return count;
}

TEST(DrawChart, HasALineAndALegendEntryPerSeries) {
  const Chart chart{.title = "Wrong < right",
                    .x_label = "noise",
                    .y_label = "share",
                    .series = {{"one", {{0.0, 1.0}, {1.0, 2.0}}}, {"two", {{0.0, 3.0}}, false}}};
  const std::string svg = DrawChart(chart);
  EXPECT_EQ(Count(svg, "<polyline"), 1);
  EXPECT_EQ(Count(svg, "<circle"), 3 + 2);  // Points and legend.
  EXPECT_THAT(svg, HasSubstr("Wrong &lt; right"));
  EXPECT_THAT(svg, HasSubstr(">one<"));
  EXPECT_THAT(svg, HasSubstr(">two<"));
}

TEST(DrawChart, LeavesOutWhatNoAxisCanShow) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Chart chart{.title = "", .x_label = "", .y_label = ""};
  chart.series = {{"", {{0.0, 1.0}, {1.0, nan}, {2.0, 0.0}, {3.0, 100.0}}}};
  chart.log_y = true;
  const std::string svg = DrawChart(chart);
  EXPECT_EQ(Count(svg, "<circle"), 2);
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  EXPECT_THAT(svg, Not(HasSubstr("inf")));
}

TEST(DrawChart, OfNothingIsAnEmptyFrame) {
  Chart chart;
  for (const bool log : {false, true}) {
    chart.log_y = log;
    const std::string svg = DrawChart(chart);
    EXPECT_EQ(Count(svg, "<circle"), 0);
    EXPECT_THAT(svg, Not(HasSubstr("nan")));
    EXPECT_THAT(svg, Not(HasSubstr("inf")));
  }
}

}  // namespace
}  // namespace shiftmap

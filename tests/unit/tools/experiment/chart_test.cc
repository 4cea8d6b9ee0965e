// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/chart.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace shiftmap {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

int Count(const std::string& text, const std::string& what) {
  int count = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) {
    ++count;
  }
  return count;
}

TEST(LinearTicks, AreRoundNumbersWithinTheRange) {
  EXPECT_THAT(LinearTicks(0.0, 1.0, 5), ElementsAre(0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0));
  EXPECT_THAT(LinearTicks(-3.0, 11.0, 4), ElementsAre(0.0, 5.0, 10.0));
  EXPECT_THAT(LinearTicks(-250.0, 250.0, 5), ElementsAre(-200.0, -100.0, 0.0, 100.0, 200.0));
}

TEST(LinearTicks, AreAboutAsManyAsAskedForAtAnyScale) {
  for (double span = 1e-9; span < 1e9; span *= 1.7) {
    const std::vector<double> ticks = LinearTicks(0.3 * span, 1.3 * span, 7);
    EXPECT_GE(ticks.size(), 3u) << span;
    EXPECT_LE(ticks.size(), 8u) << span;
    EXPECT_GE(ticks.front(), 0.3 * span * (1.0 - 1e-9));
    EXPECT_LE(ticks.back(), 1.3 * span * (1.0 + 1e-9));
  }
}

TEST(LogTicks, ArePowersOfTen) {
  EXPECT_THAT(LogTicks(0.01, 10.0), ElementsAre(0.01, 0.1, 1.0, 10.0));
  EXPECT_THAT(LogTicks(0.5, 200.0), ElementsAre(1.0, 10.0, 100.0));
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

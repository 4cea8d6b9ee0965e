// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/ticks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace shiftmap {
namespace {

using ::testing::ElementsAre;

// 2026-01-09 00:00:00 UTC.
constexpr double kDay = 1767916800.0;

std::vector<std::string> Labels(const std::vector<TimeTick>& ticks) {
  std::vector<std::string> labels;
  for (const TimeTick& tick : ticks) labels.push_back(tick.date + "|" + tick.label);
  return labels;
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

TEST(LinearTicks, EndWhereNumbersAreSparse) {
  EXPECT_LE(LinearTicks(1e17, 1e17 + 16.0, 7).size(), 1000u);
}

TEST(LogTicks, ArePowersOfTen) {
  EXPECT_THAT(LogTicks(0.01, 10.0), ElementsAre(0.01, 0.1, 1.0, 10.0));
  EXPECT_THAT(LogTicks(0.5, 200.0), ElementsAre(1.0, 10.0, 100.0));
}

TEST(TickLabels, SayTheValueItself) {
  EXPECT_EQ(PowerLabel(1e-3), "1e-3");
  EXPECT_EQ(PowerLabel(0.01), "0.01");
  EXPECT_EQ(PowerLabel(1.0), "1");
  EXPECT_EQ(PowerLabel(1e6), "1e6");
  EXPECT_EQ(LinearLabel(500000.5, 0.5), "500000.5");
  EXPECT_EQ(LinearLabel(500000.0, 20.0), "500000");
  EXPECT_EQ(LinearLabel(0.30000000000000004, 0.1), "0.3");
}

TEST(TimeTicks, AreRoundTimesOfTheDayWithTheDateWhereItChanges) {
  EXPECT_THAT(Labels(TimeTicks(kDay - 3700.0, kDay + 3700.0, 5)),
              ElementsAre("2026-01-08|23:00", "|23:30", "2026-01-09|00:00", "|00:30", "|01:00"));
  EXPECT_THAT(Labels(TimeTicks(kDay + 29.0, kDay + 61.0, 3)),
              ElementsAre("2026-01-09|00:00:30", "|00:00:45", "|00:01:00"));
}

TEST(TimeTicks, AreDaysMonthsAndYearsOfTheCalendar) {
  EXPECT_THAT(Labels(TimeTicks(kDay - 10.5 * 86400.0, kDay + 0.5 * 86400.0, 6)),
              ElementsAre("2025|12-30", "2026|01-01", "|01-03", "|01-05", "|01-07", "|01-09"));
  EXPECT_THAT(Labels(TimeTicks(kDay, kDay + 150.0 * 86400.0, 5)),
              ElementsAre("|2026-02", "|2026-03", "|2026-04", "|2026-05", "|2026-06"));
  EXPECT_THAT(Labels(TimeTicks(-4e9, 4e9, 4)),
              ElementsAre("|1850", "|1900", "|1950", "|2000", "|2050"));
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/stamp.h"

#include <gtest/gtest.h>

#include <limits>

namespace shiftmap::testing {
namespace {

TEST(StampTest, NanosecondsSurvive) {
  for (const std::int64_t ns : {std::int64_t{0},
                                std::int64_t{-1},
                                std::int64_t{1'700'000'000'123'456'789},
                                std::numeric_limits<std::int64_t>::max(),
                                std::numeric_limits<std::int64_t>::min()}) {
    EXPECT_EQ(ToNanoseconds(StampFromNanoseconds(ns)), ns);
  }
}

TEST(StampTest, SecondsRoundToTheNearestNanosecond) {
  EXPECT_EQ(FromSeconds(1.5), std::chrono::milliseconds(1500));
  EXPECT_EQ(FromSeconds(-0.1), Duration(-100'000'000));
  EXPECT_EQ(FromSeconds(1e-9 * 0.6), Duration(1));
  EXPECT_DOUBLE_EQ(ToSeconds(Duration(1'500'000'000)), 1.5);
  EXPECT_NEAR(ToSecondsSinceEpoch(StampFromSeconds(1.7e9 + 0.25)), 1.7e9 + 0.25, 2.5e-7);
}

}  // namespace
}  // namespace shiftmap::testing

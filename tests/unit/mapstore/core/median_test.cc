// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/median.h"

#include <gtest/gtest.h>

namespace shiftmap {
namespace {

TEST(Median, IsTheValueInTheMiddle) {
  EXPECT_EQ(Median(std::vector<double>{7.0}), 7.0);
  EXPECT_EQ(Median(std::vector<double>{9.0, -1.0, 2.5}), 2.5);
  EXPECT_EQ(Median(std::vector<int>{4, 1, 3, 2}), 3);  // Of two the larger one.
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/geometry/angle.h"

#include <gtest/gtest.h>

namespace shiftmap::testing {
namespace {

constexpr double kPi = std::numbers::pi;

TEST(WrapAngleTest, StaysTheSameAngleWithinHalfATurn) {
  for (double angle = -50.0; angle < 50.0; angle += 0.37) {
    const double wrapped = WrapAngle(angle);
    EXPECT_LE(std::abs(wrapped), kPi);
    EXPECT_NEAR(std::cos(wrapped), std::cos(angle), 1e-12);
    EXPECT_NEAR(std::sin(wrapped), std::sin(angle), 1e-12);
    EXPECT_EQ(WrapAngle(wrapped), wrapped);
  }
  EXPECT_DOUBLE_EQ(WrapAngle(1.5 * kPi), -0.5 * kPi);
  EXPECT_EQ(WrapAngle(0.0), 0.0);
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/geometry/arc_factors.h"

#include <gtest/gtest.h>

namespace shiftmap::testing {
namespace {

// Σ_{k >= 0} (-1)^k θ^(2k + offset - order) / (2k + offset)!, in long double: sin(θ) / θ^order
// without its first terms, or cos(θ), by the parity of the offset.
long double AlternatingSeries(long double theta, int offset, int order) {
  long double term = 1.0L;
  for (int k = 1; k <= offset; ++k) term *= (k > order ? theta : 1.0L) / k;
  long double sum = 0.0L;
  for (int k = offset; k < offset + 60; k += 2) {
    sum += term;
    term *= -theta * theta / ((k + 1) * (k + 2));
  }
  return sum;
}

void ExpectNear(double value, long double expected) {
  EXPECT_NEAR(value, static_cast<double>(expected), 1e-12 * std::abs(value) + 1e-300);
}

TEST(ArcFactorsTest, AgreeWithTheirSeries) {
  constexpr double kBound = 0.05;
  for (const double size : {1e-9, 1e-4, 0.01, kBound * (1 - 1e-9), kBound * (1 + 1e-9), 0.3, 2.9}) {
    for (const double theta : {size, -size}) {
      SCOPED_TRACE(theta);
      const ArcFactors f = ComputeArcFactors(theta);
      ExpectNear(f.sin, AlternatingSeries(theta, 1, 0));
      ExpectNear(f.cos, AlternatingSeries(theta, 0, 0));
      ExpectNear(f.sinc, AlternatingSeries(theta, 1, 1));
      ExpectNear(f.cosc, AlternatingSeries(theta, 2, 1));
      ExpectNear(f.sinc_rest, AlternatingSeries(theta, 3, 2));
      ExpectNear(f.cosc_rest, AlternatingSeries(theta, 2, 2));
    }
  }
}

TEST(ArcFactorsTest, AtZeroAreTheLimits) {
  const ArcFactors f = ComputeArcFactors(0.0);
  EXPECT_EQ(f.sin, 0.0);
  EXPECT_EQ(f.cos, 1.0);
  EXPECT_EQ(f.sinc, 1.0);
  EXPECT_EQ(f.cosc, 0.0);
  EXPECT_EQ(f.sinc_rest, 0.0);
  EXPECT_EQ(f.cosc_rest, 0.5);
}

}  // namespace
}  // namespace shiftmap::testing

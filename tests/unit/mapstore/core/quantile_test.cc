// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/quantile.h"

#include <gtest/gtest.h>

#include <random>

namespace shiftmap {
namespace {

TEST(Quantile, InterpolatesBetweenOrderStatistics) {
  const std::vector<double> values = {8.0, 1.0, 3.0, 2.0, 4.0};
  EXPECT_EQ(Quantile(values, 0.0), 1.0);
  EXPECT_EQ(Quantile(values, 0.5), 3.0);
  EXPECT_EQ(Quantile(values, 0.625), 3.5);
  EXPECT_EQ(Quantile(values, 1.0), 8.0);
  EXPECT_EQ(Quantile({5.0}, 0.95), 5.0);
}

TEST(Quantile, DoesNotDependOnTheOrder) {
  std::vector<double> values;
  for (int i = 0; i <= 1000; ++i) values.push_back(i);
  std::mt19937_64 random(1);
  std::shuffle(values.begin(), values.end(), random);
  for (const double share : {0.001, 0.25, 0.5, 0.99}) {
    EXPECT_NEAR(Quantile(values, share), 1000.0 * share, 1e-9);
  }
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/paired_test.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace shiftmap {
namespace {

constexpr double kMargin = 1.0;

TEST(PairedTest, FollowsItsFormula) {
  // By hand: mean 0.2, squares 0.26, prior 4 · 0.25², 6 degrees of freedom, t = 1.943.
  const std::vector<double> d = {0.2, -0.1, 0.5};
  const double s = std::sqrt((0.18 + 4.0 * 0.0625) / 6.0);
  const PairedTestResult result = PairedTest(d, kMargin);
  EXPECT_NEAR(result.mean, 0.2, 1e-12);
  EXPECT_NEAR(result.upper, 0.2 + 1.94318 * s / std::sqrt(3.0), 1e-5);
}

TEST(PairedTest, AMapThatIsWorseByTheMarginPassesAsOftenAsTheLevelSays) {
  std::mt19937_64 random(1);
  for (const int shifts : {5, 12, 40}) {
    // Held values would have another mean; these stay inside.
    std::normal_distribution<double> noise(1.0, 0.4);
    int passed = 0;
    constexpr int kNights = 20000;
    for (int night = 0; night < kNights; ++night) {
      std::vector<double> d(static_cast<std::size_t>(shifts));
      for (double& value : d) value = noise(random);
      passed += PairedTest(d, kMargin).not_worse() ? 1 : 0;
    }
    // The variance known beforehand is smaller than this one, which a few shifts do not outweigh.
    EXPECT_LT(static_cast<double>(passed) / kNights, shifts < 40 ? 0.09 : 0.06) << shifts;
    EXPECT_GT(static_cast<double>(passed) / kNights, 0.03) << shifts;
  }
}

TEST(PairedTest, AnHonestNightOfOneShiftPasses) {
  EXPECT_TRUE(PairedTest(std::vector<double>{0.0}, kMargin).not_worse());
  EXPECT_FALSE(PairedTest(std::vector<double>{1.0}, kMargin).not_worse());
}

TEST(PairedTest, NoGainOfOneOutweighsTheLossOfTheOthers) {
  EXPECT_FALSE(PairedTest(std::vector<double>{-1000.0, 1.5, 1.5, 1.5, 1.5}, kMargin).not_worse());
}

TEST(PairedTest, NoShiftAmongManyDecidesAlone) {
  std::vector<double> d(12, 0.0);
  d[3] = 1000.0;
  EXPECT_TRUE(PairedTest(d, kMargin).not_worse());
}

}  // namespace
}  // namespace shiftmap

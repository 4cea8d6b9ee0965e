// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/rate_limit.h"

#include <gtest/gtest.h>

#include <chrono>

namespace shiftmap::transfer {
namespace {

TEST(RateLimitTest, ManyBytesTakeAtLeastTheirTime) {
  RateLimit limit(1e6);
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(limit.Take(20'000, {}));
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  EXPECT_GE(took.count(), 0.19);
}

TEST(RateLimitTest, WithoutALimitNothingWaits) {
  RateLimit limit(0.0);
  EXPECT_TRUE(limit.Take(std::size_t{1} << 40, {}));
}

TEST(RateLimitTest, AStopEndsTheWait) {
  std::stop_source stop;
  stop.request_stop();
  RateLimit limit(1.0);
  EXPECT_FALSE(limit.Take(1'000'000, stop.get_token()));
}

}  // namespace
}  // namespace shiftmap::transfer

// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/monte_carlo.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

namespace shiftmap {
namespace {

TEST(ForEachRealization, CallsEveryNumberOnce) {
  for (const int threads : {1, 2, 7}) {
    for (const int count : {0, 1, 50}) {
      std::vector<std::atomic<int>> calls(static_cast<std::size_t>(count));
      ForEachRealization(count, threads, [&](int i) { ++calls[static_cast<std::size_t>(i)]; });
      for (const std::atomic<int>& call : calls) EXPECT_EQ(call, 1);
    }
  }
}

TEST(ThreadProcessorSeconds, GrowsWithWork) {
  const double begin = ThreadProcessorSeconds();
  volatile double sum = 0.0;
  for (int i = 0; i < 2'000'000; ++i) sum = sum + 1.0;
  EXPECT_GT(ThreadProcessorSeconds(), begin);
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/parallel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

namespace shiftmap {
namespace {

TEST(ForEachIndex, CallsEachOnceOnAnyNumberOfThreads) {
  for (const int threads : {1, 2, 7}) {
    for (const std::size_t count : {std::size_t{0}, std::size_t{1}, std::size_t{1000}}) {
      std::vector<std::atomic<int>> calls(count);
      ForEachIndex(count, threads, [&](std::size_t i) { ++calls[i]; });
      for (const std::atomic<int>& times : calls) EXPECT_EQ(times, 1);
    }
  }
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/monte_carlo.h"

#include <algorithm>
#include <atomic>
#include <ctime>
#include <thread>
#include <vector>

namespace shiftmap {

void ForEachRealization(int count, int threads, const std::function<void(int)>& body) {
  std::atomic<int> next = 0;
  const auto work = [&] {
    for (int i = next++; i < count; i = next++) body(i);
  };
  std::vector<std::thread> others;
  for (int i = 1; i < std::min(threads, count); ++i) others.emplace_back(work);
  work();
  for (std::thread& other : others) other.join();
}

double ThreadProcessorSeconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace shiftmap

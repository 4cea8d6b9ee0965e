// SPDX-License-Identifier: Apache-2.0
#include "mapper/parallel.h"

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

namespace shiftmap {

void ForEachIndex(std::size_t count, int threads, const std::function<void(std::size_t)>& body) {
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) body(i);
  };
  std::vector<std::thread> others;
  for (std::size_t i = 1; i < std::min(static_cast<std::size_t>(std::max(threads, 1)), count);
       ++i) {
    others.emplace_back(work);
  }
  work();
  for (std::thread& other : others) other.join();
}

}  // namespace shiftmap

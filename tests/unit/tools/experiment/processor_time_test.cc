// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/processor_time.h"

#include <gtest/gtest.h>

#include <thread>

namespace shiftmap {
namespace {

void Work() {
  volatile double sum = 0.0;
  for (int i = 0; i < 2'000'000; ++i) sum = sum + 1.0;
}

TEST(ProcessorTime, GrowsWithWork) {
  const double thread = ThreadProcessorSeconds();
  const double process = ProcessorSeconds();
  Work();
  EXPECT_GT(ThreadProcessorSeconds(), thread);
  EXPECT_GT(ProcessorSeconds(), process);
}

TEST(ProcessorTime, OfTheProcessIsOfAllThreads) {
  const double thread = ThreadProcessorSeconds();
  const double process = ProcessorSeconds();
  std::thread(Work).join();
  EXPECT_GT(ProcessorSeconds() - process, ThreadProcessorSeconds() - thread);
}

}  // namespace
}  // namespace shiftmap

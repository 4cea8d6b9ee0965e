// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/processor_time.h"

#include <ctime>

namespace shiftmap {
namespace {

double Seconds(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace

double ThreadProcessorSeconds() { return Seconds(CLOCK_THREAD_CPUTIME_ID); }

double ProcessorSeconds() { return Seconds(CLOCK_PROCESS_CPUTIME_ID); }

}  // namespace shiftmap

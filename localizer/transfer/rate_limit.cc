// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/rate_limit.h"

#include <algorithm>

#include "localizer/transfer/backoff.h"

namespace shiftmap::transfer {

bool RateLimit::Take(std::size_t bytes, const std::stop_token& stop) {
  if (stop.stop_requested()) return false;
  if (bytes_per_s_ <= 0.0) return true;
  const auto duration_of = [](double seconds) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  };
  const Clock::time_point now = Clock::now();
  free_at_ = std::max(free_at_, now - duration_of(0.5));
  free_at_ += duration_of(static_cast<double>(bytes) / bytes_per_s_);
  const std::chrono::duration<double> wait = free_at_ - now;
  return wait.count() <= 0.0 || SleepFor(wait.count(), stop);
}

}  // namespace shiftmap::transfer

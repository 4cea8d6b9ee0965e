// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <stop_token>

namespace shiftmap::transfer {

/// Bounds the bytes in a second, so that a transfer leaves room on the link. After a pause, half a
/// second's worth goes at once.
/// Threads: one.
class RateLimit {
 public:
  /// @param bytes_per_s  0: no limit.
  explicit RateLimit(double bytes_per_s) : bytes_per_s_(bytes_per_s), free_at_(Clock::now()) {}

  /// Waits until `bytes` may go. False if `stop` was requested meanwhile.
  bool Take(std::size_t bytes, const std::stop_token& stop);

 private:
  using Clock = std::chrono::steady_clock;

  double bytes_per_s_;
  Clock::time_point free_at_;  // When all that was taken has gone.
};

}  // namespace shiftmap::transfer

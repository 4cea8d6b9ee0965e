// SPDX-License-Identifier: Apache-2.0
//
// When a call over a bad link is tried again.
#pragma once

#include <chrono>
#include <cstdint>
#include <random>
#include <stop_token>

#include "proto/core/status.h"

namespace shiftmap::transfer {

/// The delay before try n + 1 is uniform in [0, min(longest_s, first_s 2^n)] ("full jitter"): a
/// fleet whose links failed at one time does not come back at one time.
struct BackoffOptions {
  double first_s = 0.25;    ///< Bound of the first delay. [s]
  double longest_s = 30.0;  ///< Bound of every delay. [s]

  /// Time without progress after which there is no other try. [s] Infinite: tried for ever.
  double give_up_s = 120.0;
};

/// True if the same call may succeed later: kUnavailable, kResourceExhausted, kDeadlineExceeded.
bool IsTemporary(const Status& status);

/// Waits; false if `stop` was requested before the time was over.
bool SleepFor(double seconds, const std::stop_token& stop);

/// The tries of one task.
/// Threads: one. Determinism: the delays are those of the seed.
class Backoff {
 public:
  Backoff(const BackoffOptions& options, std::uint64_t seed);

  /// The next delay. [s]
  double NextDelayS();

  /// Something went through: delays begin at the first again.
  void Progress();

  /// After a failure: waits, and says whether to try again. False if the failure will stay, time is
  /// over, or `stop` was requested.
  bool Again(const Status& status, const std::stop_token& stop);

  /// Failures that were followed by another try.
  int retries() const { return retries_; }

 private:
  using Clock = std::chrono::steady_clock;

  BackoffOptions options_;
  std::mt19937_64 random_;
  double bound_s_;
  Clock::time_point last_progress_;
  int retries_ = 0;
};

/// A seed that differs between processes and calls.
std::uint64_t RandomSeed();

}  // namespace shiftmap::transfer

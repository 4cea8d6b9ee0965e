// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/backoff.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>

namespace shiftmap::transfer {

bool IsTemporary(const Status& status) {
  return status.code() == StatusCode::kUnavailable ||
         status.code() == StatusCode::kResourceExhausted ||
         status.code() == StatusCode::kDeadlineExceeded;
}

bool SleepFor(double seconds, const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any changed;
  std::unique_lock lock(mutex);
  changed.wait_for(lock, stop, std::chrono::duration<double>(seconds), [] { return false; });
  return !stop.stop_requested();
}

Backoff::Backoff(const BackoffOptions& options, std::uint64_t seed)
    : options_(options), random_(seed), bound_s_(options.first_s), last_progress_(Clock::now()) {}

double Backoff::NextDelayS() {
  const double bound_s = std::min(bound_s_, options_.longest_s);
  bound_s_ = 2.0 * bound_s;
  return std::uniform_real_distribution<double>(0.0, bound_s)(random_);
}

void Backoff::Progress() {
  bound_s_ = options_.first_s;
  last_progress_ = Clock::now();
}

bool Backoff::Again(const Status& status, const std::stop_token& stop) {
  if (!IsTemporary(status)) return false;
  const double delay_s = NextDelayS();
  const std::chrono::duration<double> waited = Clock::now() - last_progress_;
  if (waited.count() + delay_s > options_.give_up_s) return false;
  ++retries_;
  return SleepFor(delay_s, stop);
}

std::uint64_t RandomSeed() {
  std::random_device device;
  return (std::uint64_t{device()} << 32) | device();
}

}  // namespace shiftmap::transfer

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <utility>

namespace shiftmap::transfer {

/// Lets one thread wait for another one's word. Threads: any.
class Wakeup {
 public:
  void Notify() {
    const std::lock_guard lock(mutex_);
    told_ = true;
    changed_.notify_all();
  }

  /// Waits for Notify(), which may have come before, for the time to pass, or for a request to
  /// stop. True if there was a word.
  bool WaitFor(double seconds, const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, stop, std::chrono::duration<double>(seconds), [this] { return told_; });
    return std::exchange(told_, false);
  }

 private:
  std::mutex mutex_;
  std::condition_variable_any changed_;
  bool told_ = false;
};

}  // namespace shiftmap::transfer

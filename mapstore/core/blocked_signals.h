// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <csignal>

namespace shiftmap {

/// SIGINT and SIGTERM.
sigset_t EndingSignals();

/// Blocks SIGINT and SIGTERM for the calling thread and those that it starts from then on, so that
/// one of them waits for a signal to end. The destructor takes that back.
class BlockedSignals {
 public:
  BlockedSignals();
  ~BlockedSignals();
  BlockedSignals(const BlockedSignals&) = delete;
  BlockedSignals& operator=(const BlockedSignals&) = delete;

  void Wait() const;

  /// True once one came.
  bool WaitFor(std::chrono::milliseconds time) const;

 private:
  sigset_t signals_;
  sigset_t before_;
};

}  // namespace shiftmap

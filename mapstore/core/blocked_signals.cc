// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/blocked_signals.h"

#include <ctime>

namespace shiftmap {

sigset_t EndingSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  return signals;
}

BlockedSignals::BlockedSignals() : signals_(EndingSignals()) {
  pthread_sigmask(SIG_BLOCK, &signals_, &before_);
}

BlockedSignals::~BlockedSignals() {
  // Another one that came while all was ended would kill what is left of the process.
  while (WaitFor(std::chrono::milliseconds(0))) {
  }
  pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

void BlockedSignals::Wait() const {
  int signal = 0;
  while (sigwait(&signals_, &signal) != 0) {
  }
}

bool BlockedSignals::WaitFor(std::chrono::milliseconds time) const {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(time);
  const std::chrono::nanoseconds rest = time - seconds;
  const timespec limit = {seconds.count(), rest.count()};
  return sigtimedwait(&signals_, nullptr, &limit) > 0;
}

}  // namespace shiftmap

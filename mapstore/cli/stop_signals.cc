// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/stop_signals.h"

#include <atomic>

namespace shiftmap {
namespace {

// Set by a handler, read by all threads.
std::atomic<int> received = 0;
static_assert(std::atomic<int>::is_always_lock_free);

void Keep(int signal) { received = signal; }

// A signal that the caller has this process ignore stays ignored.
void Take(int signal, const struct sigaction& action, struct sigaction* before) {
  sigaction(signal, nullptr, before);
  if (before->sa_handler != SIG_IGN) sigaction(signal, &action, nullptr);
}

}  // namespace

StopSignals::StopSignals(bool reads_end) {
  received = 0;
  struct sigaction keep = {};
  keep.sa_handler = Keep;
  // The second signal finds what was there before.
  keep.sa_flags = static_cast<int>(reads_end ? SA_RESETHAND : SA_RESTART | SA_RESETHAND);
  sigemptyset(&keep.sa_mask);
  Take(SIGINT, keep, &interrupt_);
  Take(SIGTERM, keep, &terminate_);
}

StopSignals::~StopSignals() {
  sigaction(SIGINT, &interrupt_, nullptr);
  sigaction(SIGTERM, &terminate_, nullptr);
}

std::string StopSignals::Received() {
  switch (received) {
    case SIGINT:
      return "SIGINT";
    case SIGTERM:
      return "SIGTERM";
    default:
      return "";
  }
}

Status StopSignals::Check(std::string_view what, std::string_view left) {
  const std::string signal = Received();
  if (signal.empty()) return OkStatus();
  return MakeStatus(StatusCode::kCancelled, "{} stopped by {}, {}", what, signal, left);
}

}  // namespace shiftmap

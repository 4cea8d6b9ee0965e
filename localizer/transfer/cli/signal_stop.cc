// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/cli/signal_stop.h"

#include "localizer/transfer/backoff.h"

namespace shiftmap::transfer {
namespace {

constexpr double kLookEveryS = 0.05;

}  // namespace

SignalStop::SignalStop()
    : watch_([stop = stop_](const std::stop_token& done) mutable {
        while (StopSignals::Received().empty() && SleepFor(kLookEveryS, done)) {
        }
        stop.request_stop();
      }) {}

}  // namespace shiftmap::transfer

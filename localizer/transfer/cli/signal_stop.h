// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stop_token>
#include <thread>

#include "mapstore/cli/stop_signals.h"

namespace shiftmap::transfer {

/// While it lives, the first SIGINT or SIGTERM requests a stop of what has its token; as
/// StopSignals else.
class SignalStop {
 public:
  SignalStop();

  std::stop_token token() const { return stop_.get_token(); }

 private:
  StopSignals signals_;
  std::stop_source stop_;
  std::jthread watch_;
};

}  // namespace shiftmap::transfer

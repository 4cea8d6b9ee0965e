// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>
#include <string>

namespace shiftmap {

/// While it lives, the first SIGINT or SIGTERM is kept for whoever asks instead of ending the
/// process; the second one ends it. One at a time in a process.
class StopSignals {
 public:
  StopSignals();
  ~StopSignals();
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  /// The name of the signal that came, or empty.
  static std::string Received();

 private:
  struct sigaction interrupt_;
  struct sigaction terminate_;
};

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>
#include <string>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap {

/// While it lives, the first SIGINT or SIGTERM is kept for whoever asks instead of ending the
/// process; the second one ends it. One at a time in a process.
class StopSignals {
 public:
  /// @param reads_end  A read that waits, as for a pipe, fails with the signal; else it goes on.
  explicit StopSignals(bool reads_end = false);
  ~StopSignals();
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  /// The name of the signal that came, or empty.
  static std::string Received();

  /// kCancelled `WHAT stopped by SIGNAL, LEFT` if one came.
  /// @param left  What is left behind.
  static Status Check(std::string_view what, std::string_view left = "nothing is written");

 private:
  struct sigaction interrupt_;
  struct sigaction terminate_;
};

}  // namespace shiftmap

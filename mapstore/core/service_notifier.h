// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>

#include "mapstore/core/owned_fd.h"

namespace shiftmap {

/// Tells the service manager what this process is doing, by the protocol of sd_notify(3): lines in
/// a datagram to the Unix socket that $NOTIFY_SOCKET names. Without that variable it does nothing.
///
/// A manager that does not listen is no error of ours: what cannot be sent is not sent.
class ServiceNotifier {
 public:
  ServiceNotifier();

  void Ready() { Send("READY=1\nSTATUS=serving"); }
  void Stopping() { Send("STOPPING=1\nSTATUS=saving"); }

  /// That the process is alive; at most every half of the interval that the manager asks for in
  /// $WATCHDOG_USEC, however often it is called.
  void Alive();

  /// That starting or stopping goes on, and may take some seconds more.
  void StillStarting();

  /// How often Alive() should be called, if the manager watches.
  std::optional<std::chrono::milliseconds> interval() const { return interval_; }

 private:
  using Clock = std::chrono::steady_clock;

  void Send(std::string_view lines);

  std::string address_;
  OwnedFd socket_;
  std::optional<std::chrono::milliseconds> interval_;
  std::optional<Clock::time_point> last_sign_;
};

}  // namespace shiftmap

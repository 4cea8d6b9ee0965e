// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "localizer/live/framing.h"
#include "localizer/live/messages.h"
#include "mapstore/core/owned_fd.h"
#include "proto/core/status.h"

namespace shiftmap::live {

/// The vehicle's end of the socket; every call waits until it is done.
class Client {
 public:
  /// Errors: as ConnectTo.
  static StatusOr<Client> Connect(const std::string& path);

  /// Errors: kUnavailable if the service is gone; kInvalidArgument for one above kMaxFrameBytes.
  Status Send(const Request& request);

  /// The next event. Errors also: kInvalidArgument for what is none.
  StatusOr<Event> Receive();

  /// The same, or nothing if none came within a time. [s]
  StatusOr<std::optional<Event>> ReceiveWithin(double seconds);

  /// Sends a command and waits for its reply; events that come before it are skipped. The reply's
  /// own error is returned as one.
  StatusOr<Reply> Call(const Command& command);

 private:
  explicit Client(OwnedFd fd) : fd_(std::move(fd)) {}

  Status Read();

  OwnedFd fd_;
  FrameReader reader_;
  std::uint64_t last_id_ = 0;
};

}  // namespace shiftmap::live

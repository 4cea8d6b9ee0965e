// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/socket.h>

#include <optional>
#include <string>

#include "proto/core/status.h"

namespace shiftmap {

/// Where a server listens.
struct ListenAddress {
  std::string host = "127.0.0.1";  ///< An address or a name, without brackets.
  int port = 0;                    ///< 0: any that is free.

  /// To bind to. A name is not looked up: nothing, but for `localhost`, which is 127.0.0.1.
  std::optional<sockaddr_storage> SocketAddress() const;

  /// Whether there is one.
  bool IsAddress() const { return SocketAddress().has_value(); }

  /// Whether only this machine reaches it. Of names, `localhost` only.
  bool IsLoopback() const;

  /// "host:port", an IPv6 address in brackets.
  std::string Text() const;

  /// As browsers write it.
  std::string Url() const { return "http://" + Text() + "/"; }
};

/// Reads `HOST:PORT`, `[IPV6]:PORT`, or with a default host also `PORT`.
/// Errors: kInvalidArgument, starting with `option`.
StatusOr<ListenAddress> ParseListenAddress(const std::string& option,
                                           const std::string& text,
                                           const std::string& default_host = "");

}  // namespace shiftmap

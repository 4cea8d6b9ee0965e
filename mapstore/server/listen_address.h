// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "proto/core/status.h"

namespace shiftmap::server {

/// Where a server listens.
struct ListenAddress {
  std::string host;  ///< An address or a name, without brackets.
  int port = 0;      ///< 0: any that is free.

  /// Whether only this machine can reach it. A name is not looked up: only `localhost` is.
  bool IsLoopback() const;

  /// "host:port", an IPv6 address in brackets.
  std::string Text() const;
};

/// Reads `HOST:PORT`, `[IPV6]:PORT`, or with a default host also `PORT`.
/// Errors: kInvalidArgument, starting with `option`.
StatusOr<ListenAddress> ParseListenAddress(const std::string& option,
                                           const std::string& text,
                                           const std::string& default_host = "");

}  // namespace shiftmap::server

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "mapstore/server/listen_address.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// Answers `GET /metrics` over HTTP while it lives.
class MetricsEndpoint {
 public:
  /// @param address  With an IP address, or `localhost`.
  /// @param text     Makes what is answered; called in a thread of the endpoint.
  /// Errors: kInvalidArgument if the host is no address; kUnavailable if it cannot listen.
  static StatusOr<std::unique_ptr<MetricsEndpoint>> Start(const ListenAddress& address,
                                                          std::function<std::string()> text);
  ~MetricsEndpoint();
  MetricsEndpoint(const MetricsEndpoint&) = delete;
  MetricsEndpoint& operator=(const MetricsEndpoint&) = delete;

  /// With the port that it got.
  const ListenAddress& address() const;

 private:
  struct State;
  explicit MetricsEndpoint(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap::server

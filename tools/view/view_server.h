// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "proto/core/status.h"

namespace shiftmap {

/// Where a server listens.
struct ListenAddress {
  std::string host = "127.0.0.1";  ///< An IPv4 or IPv6 address, without brackets.
  int port = 0;                    ///< 0: one that is free.

  /// Whether only this machine reaches the address.
  bool IsLoopback() const;

  /// As browsers write it.
  std::string Url() const;
};

/// "ADDRESS:PORT"; an IPv6 address stands in brackets. `localhost` is 127.0.0.1.
/// Errors: kInvalidArgument if it is not.
StatusOr<ListenAddress> ParseListenAddress(const std::string& text);

/// Whether a Host header names the server by an address, or by a name of this machine. Any other
/// name may be one that a foreign page has pointed to this server.
bool IsOwnHost(const std::string& host_header);

/// Serves one page over HTTP to browsers: GET and HEAD of `/`, nothing else.
///
/// Bounds: 16 connections at a time, 8 KiB of request line and headers, no body, 10 s of silence.
/// Every answer forbids to be framed, guessed or shared with other origins.
///
/// Threads: one object a process. It answers from a thread of its own.
class ViewServer {
 public:
  /// Gives the page; called for a request if the last page is older than two seconds. Its error
  /// goes to the browser.
  using PageMaker = std::function<StatusOr<std::string>()>;

  /// Answers from now on. SIGINT and SIGTERM are kept for WaitForSignal().
  /// Errors: kUnavailable if the address cannot be listened on.
  static StatusOr<ViewServer> Start(const ListenAddress& address, PageMaker make_page);

  ViewServer(ViewServer&&) noexcept;
  ViewServer& operator=(ViewServer&&) noexcept;

  /// Closes all connections.
  ~ViewServer();

  /// With the port that was taken.
  const ListenAddress& address() const;

  /// Returns when SIGINT or SIGTERM comes.
  void WaitForSignal();

 private:
  struct State;
  explicit ViewServer(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap

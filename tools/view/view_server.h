// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "mapstore/http/listen_address.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Whether a Host header names the server by an address, or by a name of this machine. Any other
/// name may be one that a foreign page has pointed to this server.
bool IsOwnHost(const std::string& host_header);

/// Serves one page over HTTP to browsers: GET and HEAD of `/`, nothing else.
///
/// Bounds are those of HttpListener. Every answer forbids to be framed, guessed or shared with
/// other origins.
///
/// Threads: one object a process. It answers from a thread of its own.
class ViewServer {
 public:
  /// Gives the page; called for a request if the last page is older than two seconds. Its error
  /// goes to the browser.
  using PageMaker = std::function<StatusOr<std::string>()>;

  /// Answers from now on. SIGINT and SIGTERM are kept for WaitForSignal().
  /// Errors: as HttpListener::Start.
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

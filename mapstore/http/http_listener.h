// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/http/listen_address.h"
#include "proto/core/status.h"

namespace shiftmap {

struct HttpRequest {
  std::string path;
  std::string host;  ///< The header `Host`; empty if there is none.
};

struct HttpResponse {
  HttpResponse(int status, std::shared_ptr<const std::string> body)
      : code(status), text(std::move(body)) {}
  HttpResponse(int status, std::string body)
      : HttpResponse(status, std::make_shared<const std::string>(std::move(body))) {}

  int code = 200;
  std::shared_ptr<const std::string> text;  ///< Not null.
  std::string content_type = "text/plain; charset=utf-8";
  std::vector<std::pair<std::string, std::string>> headers;  ///< Name and value, others than these.
};

/// Answers GET and HEAD over HTTP while it lives; other methods, and requests with a body, are
/// refused.
///
/// Bounds: 16 connections at a time, 8 KiB of request line and headers, 10 s of silence.
class HttpListener {
 public:
  /// Called in a thread of the listener, once at a time.
  using Handler = std::function<HttpResponse(const HttpRequest&)>;

  /// @param headers  Of every response, the refusals too.
  /// Errors: kInvalidArgument if the host is no address; kUnavailable if it cannot be listened on.
  static StatusOr<HttpListener> Start(
      const ListenAddress& address,
      Handler handler,
      std::vector<std::pair<std::string, std::string>> headers = {});

  HttpListener(HttpListener&&) noexcept;
  HttpListener& operator=(HttpListener&&) noexcept;

  /// Closes all connections.
  ~HttpListener();

  /// With the port that it got.
  const ListenAddress& address() const;

 private:
  struct State;
  explicit HttpListener(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap

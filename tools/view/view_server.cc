// SPDX-License-Identifier: Apache-2.0
#include "tools/view/view_server.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>
#include <utility>

#include "mapstore/core/blocked_signals.h"
#include "mapstore/http/http_listener.h"
#include "tools/view/page_template.h"

namespace shiftmap {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kPageAge{2};

std::string Lowercase(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) {
    return static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  });
  return text;
}

}  // namespace

bool IsOwnHost(const std::string& host_header) {
  const bool has_port = !host_header.ends_with(']') && host_header.find(':') != std::string::npos;
  const StatusOr<ListenAddress> named =
      ParseListenAddress("Host", has_port ? host_header : host_header + ":80");
  if (!named.ok()) return false;
  const std::string host = Lowercase(named->host);
  if (ListenAddress{host, 0}.IsAddress()) return true;
  std::array<char, 256> name = {};
  if (gethostname(name.data(), name.size() - 1) != 0) return false;
  return host == Lowercase(name.data());
}

struct ViewServer::State {
  HttpResponse Respond(const HttpRequest& request) {
    if (!IsOwnHost(request.host)) return {421, "this is not the host you asked for\n"};
    if (request.path != "/") return {404, "not found\n"};
    StatusOr<std::shared_ptr<const std::string>> text = Page();
    if (!text.ok()) return {503, Message(text.status()) + "\n"};
    HttpResponse response(200, *std::move(text));
    response.content_type = "text/html; charset=utf-8";
    return response;
  }

  // The one of a moment ago, or another.
  StatusOr<std::shared_ptr<const std::string>> Page() {
    if (page && Clock::now() - page_made < kPageAge) return page;
    SHIFTMAP_ASSIGN_OR_RETURN(std::string text, make_page());
    page = std::make_shared<const std::string>(std::move(text));
    page_made = Clock::now();
    return page;
  }

  BlockedSignals signals;
  PageMaker make_page;
  std::shared_ptr<const std::string> page;
  Clock::time_point page_made;
  std::optional<HttpListener> listener;  // Ends before the page.
};

StatusOr<ViewServer> ViewServer::Start(const ListenAddress& address, PageMaker make_page) {
  auto state = std::make_unique<State>();
  state->make_page = std::move(make_page);
  SHIFTMAP_ASSIGN_OR_RETURN(
      state->listener,
      HttpListener::Start(
          address,
          [parts = state.get()](const HttpRequest& request) { return parts->Respond(request); },
          {{"Content-Security-Policy",
            ViewPageTemplate().content_security_policy + "; frame-ancestors 'none'"},
           {"X-Content-Type-Options", "nosniff"},
           {"X-Frame-Options", "DENY"},
           {"Referrer-Policy", "no-referrer"},
           {"Cross-Origin-Resource-Policy", "same-origin"},
           {"Cross-Origin-Opener-Policy", "same-origin"},
           {"Cache-Control", "no-store"}}));
  return ViewServer(std::move(state));
}

ViewServer::ViewServer(std::unique_ptr<State> state) : state_(std::move(state)) {}
ViewServer::ViewServer(ViewServer&&) noexcept = default;
ViewServer& ViewServer::operator=(ViewServer&&) noexcept = default;
ViewServer::~ViewServer() = default;

const ListenAddress& ViewServer::address() const { return state_->listener->address(); }

void ViewServer::WaitForSignal() { state_->signals.Wait(); }

}  // namespace shiftmap

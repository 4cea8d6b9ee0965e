// SPDX-License-Identifier: Apache-2.0
//
// The only place that knows libmicrohttpd.
#include "tools/view/view_server.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <strings.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>
#include <optional>
#include <string_view>
#include <utility>

#include "mapstore/core/blocked_signals.h"
#include "tools/view/page_template.h"

namespace shiftmap {
namespace {

using Clock = std::chrono::steady_clock;

constexpr unsigned kMaxConnections = 16;
constexpr std::size_t kMaxRequestBytes = 8192;
constexpr unsigned kSilenceS = 10;
constexpr std::chrono::seconds kPageAge{2};

struct SocketAddress {
  sockaddr_storage storage = {};
  sockaddr* get() { return reinterpret_cast<sockaddr*>(&storage); }
};

// Nothing if `host` is no address.
std::optional<SocketAddress> ToSocketAddress(const std::string& host, int port) {
  SocketAddress address;
  auto* const v4 = reinterpret_cast<sockaddr_in*>(&address.storage);
  if (inet_pton(AF_INET, host.c_str(), &v4->sin_addr) == 1) {
    v4->sin_family = AF_INET;
    v4->sin_port = htons(static_cast<std::uint16_t>(port));
    return address;
  }
  auto* const v6 = reinterpret_cast<sockaddr_in6*>(&address.storage);
  address.storage = {};
  if (inet_pton(AF_INET6, host.c_str(), &v6->sin6_addr) == 1) {
    v6->sin6_family = AF_INET6;
    v6->sin6_port = htons(static_cast<std::uint16_t>(port));
    return address;
  }
  return std::nullopt;
}

bool IsAddress(const std::string& host) { return ToSocketAddress(host, 0).has_value(); }

struct HostAndPort {
  std::string host;
  std::optional<int> port;
};

// "host", "host:port", "[v6]", "[v6]:port". Nothing if it is none of these.
std::optional<HostAndPort> SplitHost(std::string_view text) {
  HostAndPort split;
  std::size_t end = text.find(':');
  if (text.starts_with('[')) {
    end = text.find(']');
    if (end == std::string_view::npos) return std::nullopt;
    split.host = text.substr(1, end - 1);
    ++end;
  } else {
    end = std::min(end, text.size());
    split.host = text.substr(0, end);
  }
  if (split.host.empty()) return std::nullopt;
  if (end == text.size()) return split;
  const std::string_view digits = text.substr(end + 1);
  int port = -1;
  const auto [last, error] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  const bool whole = error == std::errc() && last == digits.data() + digits.size();
  if (text[end] != ':' || !whole || port < 0 || port > 65535) return std::nullopt;
  split.port = port;
  return split;
}

std::string Lowercase(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) {
    return static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  });
  return text;
}

}  // namespace

bool ListenAddress::IsLoopback() const { return host.starts_with("127.") || host == "::1"; }

std::string ListenAddress::Url() const {
  const bool v6 = host.find(':') != std::string::npos;
  return fmt::format("http://{}{}{}:{}/", v6 ? "[" : "", host, v6 ? "]" : "", port);
}

StatusOr<ListenAddress> ParseListenAddress(const std::string& text) {
  const std::optional<HostAndPort> split = SplitHost(text);
  if (!split || !split->port) {
    return InvalidArgument("--listen '{}', expected ADDRESS:PORT", text);
  }
  ListenAddress address = {split->host == "localhost" ? "127.0.0.1" : split->host, *split->port};
  if (!IsAddress(address.host)) {
    return InvalidArgument("--listen '{}', expected an IP address, not a name", text);
  }
  return address;
}

bool IsOwnHost(const std::string& host_header) {
  const std::optional<HostAndPort> split = SplitHost(host_header);
  if (!split) return false;
  const std::string host = Lowercase(split->host);
  if (host == "localhost" || IsAddress(host)) return true;
  std::array<char, 256> name = {};
  if (gethostname(name.data(), name.size() - 1) != 0) return false;
  return host == Lowercase(name.data());
}

struct ViewServer::State {
  ~State() {
    if (daemon != nullptr) MHD_stop_daemon(daemon);
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
  ListenAddress address;
  PageMaker make_page;
  std::shared_ptr<const std::string> page;
  Clock::time_point page_made;
  MHD_Daemon* daemon = nullptr;
};

namespace {

using SharedText = std::shared_ptr<const std::string>;

void FreeShared(void* shared) { delete static_cast<SharedText*>(shared); }

MHD_Result Answer(MHD_Connection* connection,
                  unsigned code,
                  const char* content_type,
                  SharedText text) {
  // libmicrohttpd reads the text and does not write it.
  void* const bytes = const_cast<char*>(text->data());
  const std::size_t size = text->size();
  MHD_Response* const response = MHD_create_response_from_buffer_with_free_callback_cls(
      size, bytes, FreeShared, new SharedText(std::move(text)));
  if (response == nullptr) return MHD_NO;
  const std::string policy =
      ViewPageTemplate().content_security_policy + "; frame-ancestors 'none'";
  const std::array<std::pair<const char*, const char*>, 8> headers = {{
      {"Content-Type", content_type},
      {"Content-Security-Policy", policy.c_str()},
      {"X-Content-Type-Options", "nosniff"},
      {"X-Frame-Options", "DENY"},
      {"Referrer-Policy", "no-referrer"},
      {"Cross-Origin-Resource-Policy", "same-origin"},
      {"Cross-Origin-Opener-Policy", "same-origin"},
      {"Cache-Control", "no-store"},
  }};
  for (const auto& [name, value] : headers) MHD_add_response_header(response, name, value);
  if (code == MHD_HTTP_METHOD_NOT_ALLOWED) {
    MHD_add_response_header(response, "Allow", "GET, HEAD");
  }
  if (code != MHD_HTTP_OK) MHD_add_response_header(response, "Connection", "close");
  const MHD_Result result = MHD_queue_response(connection, code, response);
  MHD_destroy_response(response);
  return result;
}

MHD_Result Refuse(MHD_Connection* connection, unsigned code, const std::string& why) {
  return Answer(connection,
                code,
                "text/plain; charset=utf-8",
                std::make_shared<const std::string>(why + "\n"));
}

bool HasBody(MHD_Connection* connection) {
  const auto value = [&](const char* name) {
    const char* const text = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
    return std::string_view(text == nullptr ? "" : text);
  };
  const std::string_view length = value("Content-Length");
  return !value("Transfer-Encoding").empty() || (!length.empty() && length != "0");
}

// Called when the headers of a request have come.
template <typename State>
MHD_Result Handle(void* server,
                  MHD_Connection* connection,
                  const char* url,
                  const char* method,
                  const char* /*version*/,
                  const char* /*upload*/,
                  std::size_t* /*upload_size*/,
                  void** /*request*/) {
  if (std::strcmp(method, "GET") != 0 && std::strcmp(method, "HEAD") != 0) {
    return Refuse(connection, MHD_HTTP_METHOD_NOT_ALLOWED, "only GET and HEAD");
  }
  if (HasBody(connection)) return Refuse(connection, MHD_HTTP_BAD_REQUEST, "no body, please");
  const char* const host = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, "Host");
  if (host == nullptr || !IsOwnHost(host)) {
    return Refuse(connection, MHD_HTTP_MISDIRECTED_REQUEST, "this is not the host you asked for");
  }
  if (std::strcmp(url, "/") != 0) return Refuse(connection, MHD_HTTP_NOT_FOUND, "not found");
  StatusOr<SharedText> page = static_cast<State*>(server)->Page();
  if (!page.ok()) {
    return Refuse(connection, MHD_HTTP_SERVICE_UNAVAILABLE, Message(page.status()));
  }
  return Answer(connection, MHD_HTTP_OK, "text/html; charset=utf-8", *std::move(page));
}

}  // namespace

StatusOr<ViewServer> ViewServer::Start(const ListenAddress& address, PageMaker make_page) {
  std::optional<SocketAddress> where = ToSocketAddress(address.host, address.port);
  if (!where) return InvalidArgument("'{}' is no IP address", address.host);
  auto state = std::make_unique<State>();
  state->address = address;
  state->make_page = std::move(make_page);
  unsigned flags = MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_AUTO;
  if (where->storage.ss_family == AF_INET6) flags |= MHD_USE_IPv6;
  state->daemon = MHD_start_daemon(flags,
                                   0,
                                   nullptr,
                                   nullptr,
                                   Handle<State>,
                                   state.get(),
                                   MHD_OPTION_SOCK_ADDR,
                                   where->get(),
                                   MHD_OPTION_CONNECTION_LIMIT,
                                   kMaxConnections,
                                   MHD_OPTION_CONNECTION_MEMORY_LIMIT,
                                   kMaxRequestBytes,
                                   MHD_OPTION_CONNECTION_TIMEOUT,
                                   kSilenceS,
                                   MHD_OPTION_END);
  if (state->daemon == nullptr) {
    return Unavailable("cannot listen on {}: {}", address.Url(), std::strerror(errno));
  }
  const MHD_DaemonInfo* const info = MHD_get_daemon_info(state->daemon, MHD_DAEMON_INFO_BIND_PORT);
  if (info != nullptr) state->address.port = info->port;
  return ViewServer(std::move(state));
}

ViewServer::ViewServer(std::unique_ptr<State> state) : state_(std::move(state)) {}
ViewServer::ViewServer(ViewServer&&) noexcept = default;
ViewServer& ViewServer::operator=(ViewServer&&) noexcept = default;
ViewServer::~ViewServer() = default;

const ListenAddress& ViewServer::address() const { return state_->address; }

void ViewServer::WaitForSignal() { state_->signals.Wait(); }

}  // namespace shiftmap

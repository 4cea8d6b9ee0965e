// SPDX-License-Identifier: Apache-2.0
//
// The only place that knows libmicrohttpd.
#include "mapstore/http/http_listener.h"

#include <microhttpd.h>

#include <cerrno>
#include <cstring>
#include <optional>
#include <string_view>

namespace shiftmap {
namespace {

constexpr unsigned kMaxConnections = 16;
constexpr std::size_t kMaxRequestBytes = 8192;
constexpr unsigned kSilenceS = 10;

using SharedText = std::shared_ptr<const std::string>;

std::string HeaderOf(MHD_Connection* connection, const char* name) {
  const char* const text = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  return text == nullptr ? "" : text;
}

bool HasBody(MHD_Connection* connection) {
  const std::string length = HeaderOf(connection, "Content-Length");
  return !HeaderOf(connection, "Transfer-Encoding").empty() || (!length.empty() && length != "0");
}

}  // namespace

struct HttpListener::State {
  ~State() {
    if (daemon != nullptr) MHD_stop_daemon(daemon);
  }

  HttpResponse Respond(MHD_Connection* connection,
                       const char* path,
                       std::string_view method) const {
    if (method != "GET" && method != "HEAD") {
      HttpResponse response(MHD_HTTP_METHOD_NOT_ALLOWED, "only GET and HEAD\n");
      response.headers.emplace_back("Allow", "GET, HEAD");
      return response;
    }
    if (HasBody(connection)) {
      return {MHD_HTTP_BAD_REQUEST, "a request with a body is refused\n"};
    }
    return handler({path, HeaderOf(connection, "Host")});
  }

  MHD_Result Send(MHD_Connection* connection, HttpResponse answer) const;

  // Called when the headers of a request have come.
  static MHD_Result Handle(void* state,
                           MHD_Connection* connection,
                           const char* path,
                           const char* method,
                           const char* /*version*/,
                           const char* /*upload*/,
                           std::size_t* /*upload_size*/,
                           void** /*request*/) {
    const auto* const listener = static_cast<const State*>(state);
    return listener->Send(connection, listener->Respond(connection, path, method));
  }

  ListenAddress address;
  Handler handler;
  std::vector<std::pair<std::string, std::string>> headers;
  MHD_Daemon* daemon = nullptr;
};

MHD_Result HttpListener::State::Send(MHD_Connection* connection, HttpResponse answer) const {
  // libmicrohttpd reads the text and does not write it.
  void* const bytes = const_cast<char*>(answer.text->data());
  const std::size_t size = answer.text->size();
  MHD_Response* const response = MHD_create_response_from_buffer_with_free_callback_cls(
      size,
      bytes,
      [](void* shared) { delete static_cast<SharedText*>(shared); },
      new SharedText(std::move(answer.text)));
  if (response == nullptr) return MHD_NO;
  const auto add = [&](const std::string& name, const std::string& value) {
    MHD_add_response_header(response, name.c_str(), value.c_str());
  };
  add("Content-Type", answer.content_type);
  for (const auto& [name, value] : headers) add(name, value);
  for (const auto& [name, value] : answer.headers) add(name, value);
  if (answer.code != MHD_HTTP_OK) add("Connection", "close");
  const MHD_Result result =
      MHD_queue_response(connection, static_cast<unsigned>(answer.code), response);
  MHD_destroy_response(response);
  return result;
}

StatusOr<HttpListener> HttpListener::Start(
    const ListenAddress& address,
    Handler handler,
    std::vector<std::pair<std::string, std::string>> headers) {
  std::optional<sockaddr_storage> where = address.SocketAddress();
  if (!where) return InvalidArgument("'{}' is no IP address", address.host);
  auto state = std::make_unique<State>();
  state->address = address;
  state->handler = std::move(handler);
  state->headers = std::move(headers);
  unsigned flags = MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_AUTO;
  if (where->ss_family == AF_INET6) flags |= MHD_USE_IPv6;
  state->daemon = MHD_start_daemon(flags,
                                   0,
                                   nullptr,
                                   nullptr,
                                   &State::Handle,
                                   state.get(),
                                   MHD_OPTION_SOCK_ADDR,
                                   reinterpret_cast<sockaddr*>(&*where),
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
  return HttpListener(std::move(state));
}

HttpListener::HttpListener(std::unique_ptr<State> state) : state_(std::move(state)) {}
HttpListener::HttpListener(HttpListener&&) noexcept = default;
HttpListener& HttpListener::operator=(HttpListener&&) noexcept = default;
HttpListener::~HttpListener() = default;

const ListenAddress& HttpListener::address() const { return state_->address; }

}  // namespace shiftmap

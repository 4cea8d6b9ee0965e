// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/metrics_endpoint.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>

#include <cstdint>
#include <cstring>
#include <utility>

namespace shiftmap::server {
namespace {

constexpr unsigned kMaxConnections = 16;
constexpr unsigned kSilenceS = 10;

// Room for an address of either kind; false if it is none.
bool ToSocketAddress(const ListenAddress& address, sockaddr_storage* out) {
  *out = {};
  const std::string host = address.host == "localhost" ? "127.0.0.1" : address.host;
  auto* const v4 = reinterpret_cast<sockaddr_in*>(out);
  auto* const v6 = reinterpret_cast<sockaddr_in6*>(out);
  const std::uint16_t port = htons(static_cast<std::uint16_t>(address.port));
  if (inet_pton(AF_INET, host.c_str(), &v4->sin_addr) == 1) {
    v4->sin_family = AF_INET;
    v4->sin_port = port;
    return true;
  }
  if (inet_pton(AF_INET6, host.c_str(), &v6->sin6_addr) == 1) {
    v6->sin6_family = AF_INET6;
    v6->sin6_port = port;
    return true;
  }
  return false;
}

MHD_Result Answer(MHD_Connection* connection, unsigned code, const std::string& text) {
  // MHD_RESPMEM_MUST_COPY: the text is not written to.
  MHD_Response* const response = MHD_create_response_from_buffer(
      text.size(), const_cast<char*>(text.data()), MHD_RESPMEM_MUST_COPY);
  if (response == nullptr) return MHD_NO;
  MHD_add_response_header(response, "Content-Type", "text/plain; version=0.0.4; charset=utf-8");
  const MHD_Result result = MHD_queue_response(connection, code, response);
  MHD_destroy_response(response);
  return result;
}

}  // namespace

struct MetricsEndpoint::State {
  ~State() {
    if (daemon != nullptr) MHD_stop_daemon(daemon);
  }

  static MHD_Result Handle(void* state,
                           MHD_Connection* connection,
                           const char* url,
                           const char* method,
                           const char* /*version*/,
                           const char* /*upload*/,
                           std::size_t* /*upload_size*/,
                           void** /*request*/) {
    if (std::strcmp(method, "GET") != 0) {
      return Answer(connection, MHD_HTTP_METHOD_NOT_ALLOWED, "only GET\n");
    }
    if (std::strcmp(url, "/metrics") != 0) {
      return Answer(connection, MHD_HTTP_NOT_FOUND, "only /metrics\n");
    }
    return Answer(connection, MHD_HTTP_OK, static_cast<State*>(state)->text());
  }

  ListenAddress address;
  std::function<std::string()> text;
  MHD_Daemon* daemon = nullptr;
};

MetricsEndpoint::MetricsEndpoint(std::unique_ptr<State> state) : state_(std::move(state)) {}
MetricsEndpoint::~MetricsEndpoint() = default;

const ListenAddress& MetricsEndpoint::address() const { return state_->address; }

StatusOr<std::unique_ptr<MetricsEndpoint>> MetricsEndpoint::Start(
    const ListenAddress& address, std::function<std::string()> text) {
  sockaddr_storage where = {};
  if (!ToSocketAddress(address, &where)) {
    return InvalidArgument("metrics: '{}' is no IP address", address.host);
  }
  auto state = std::make_unique<State>();
  state->address = address;
  state->text = std::move(text);
  unsigned flags = MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_AUTO;
  if (where.ss_family == AF_INET6) flags |= MHD_USE_IPv6;
  state->daemon = MHD_start_daemon(flags,
                                   0,
                                   nullptr,
                                   nullptr,
                                   &State::Handle,
                                   state.get(),
                                   MHD_OPTION_SOCK_ADDR,
                                   reinterpret_cast<sockaddr*>(&where),
                                   MHD_OPTION_CONNECTION_LIMIT,
                                   kMaxConnections,
                                   MHD_OPTION_CONNECTION_TIMEOUT,
                                   kSilenceS,
                                   MHD_OPTION_END);
  if (state->daemon == nullptr) {
    return Unavailable("metrics: cannot listen on {}", address.Text());
  }
  const MHD_DaemonInfo* const info = MHD_get_daemon_info(state->daemon, MHD_DAEMON_INFO_BIND_PORT);
  if (info != nullptr) state->address.port = info->port;
  return std::unique_ptr<MetricsEndpoint>(new MetricsEndpoint(std::move(state)));
}

}  // namespace shiftmap::server

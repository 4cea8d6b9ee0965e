// SPDX-License-Identifier: Apache-2.0
#include "mapstore/http/listen_address.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <cstdint>

#include "mapstore/core/parse_whole.h"

namespace shiftmap {

std::optional<sockaddr_storage> ListenAddress::SocketAddress() const {
  const std::string numeric = host == "localhost" ? "127.0.0.1" : host;
  const std::uint16_t port_of_network = htons(static_cast<std::uint16_t>(port));
  sockaddr_storage storage = {};
  auto* const v4 = reinterpret_cast<sockaddr_in*>(&storage);
  if (inet_pton(AF_INET, numeric.c_str(), &v4->sin_addr) == 1) {
    v4->sin_family = AF_INET;
    v4->sin_port = port_of_network;
    return storage;
  }
  auto* const v6 = reinterpret_cast<sockaddr_in6*>(&storage);
  if (inet_pton(AF_INET6, numeric.c_str(), &v6->sin6_addr) == 1) {
    v6->sin6_family = AF_INET6;
    v6->sin6_port = port_of_network;
    return storage;
  }
  return std::nullopt;
}

bool ListenAddress::IsLoopback() const {
  return host == "localhost" || host == "::1" || (IsAddress() && host.starts_with("127."));
}

std::string ListenAddress::Text() const {
  const bool v6 = host.find(':') != std::string::npos;
  return fmt::format("{}{}{}:{}", v6 ? "[" : "", host, v6 ? "]" : "", port);
}

StatusOr<ListenAddress> ParseListenAddress(const std::string& option,
                                           const std::string& text,
                                           const std::string& default_host) {
  const std::size_t colon = text.rfind(':');
  std::string host = colon == std::string::npos ? default_host : text.substr(0, colon);
  const std::string port = colon == std::string::npos ? text : text.substr(colon + 1);
  const bool brackets = host.starts_with('[') && host.ends_with(']');
  if (brackets) host = host.substr(1, host.size() - 2);
  const std::optional<int> number = ParseWhole<int>(port);
  const bool v6 = host.find(':') != std::string::npos;
  if (host.empty() || v6 != brackets || !number || *number < 0 || *number > 65535) {
    return InvalidArgument(
        "{} '{}': expected {}HOST:PORT", option, text, default_host.empty() ? "" : "PORT or ");
  }
  return ListenAddress{host, *number};
}

}  // namespace shiftmap

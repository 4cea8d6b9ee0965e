// SPDX-License-Identifier: Apache-2.0
#include "mapstore/http/listen_address.h"

#include <arpa/inet.h>

#include <optional>

#include "mapstore/core/parse_whole.h"

namespace shiftmap {
namespace {

bool IsV4(const std::string& host) {
  in_addr address = {};
  return inet_pton(AF_INET, host.c_str(), &address) == 1;
}

bool IsV6(const std::string& host) {
  in6_addr address = {};
  return inet_pton(AF_INET6, host.c_str(), &address) == 1;
}

}  // namespace

bool ListenAddress::IsAddress() const { return host == "localhost" || IsV4(host) || IsV6(host); }

bool ListenAddress::IsLoopback() const {
  return host == "localhost" || host == "::1" || (IsV4(host) && host.starts_with("127."));
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

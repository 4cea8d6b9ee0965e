// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/server_options.h"

#include <fmt/format.h>

#include <utility>

namespace shiftmap::transfer {
namespace {

constexpr int kMaxPort = 65535;

bool IsLoopback(const std::string& host) {
  return host == "localhost" || host == "[::1]" || host.starts_with("127.");
}

std::pair<std::string, std::string> SplitPort(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  if (colon == std::string::npos) return {address, ""};
  return {address.substr(0, colon), address.substr(colon + 1)};
}

bool IsPort(const std::string& text) {
  return !text.empty() && text.size() <= 5 &&
         text.find_first_not_of("0123456789") == std::string::npos && std::stoi(text) > 0 &&
         std::stoi(text) <= kMaxPort;
}

}  // namespace

std::string CheckServerOptions(const ServerOptions& options) {
  const auto [host, port] = SplitPort(options.address);
  if (host.empty() || !IsPort(port)) {
    return fmt::format("--server '{}', expected HOST:PORT", options.address);
  }
  const bool any = !options.tls_ca.empty() || !options.tls_cert.empty() || !options.tls_key.empty();
  const bool all = !options.tls_ca.empty() && !options.tls_cert.empty() && !options.tls_key.empty();
  if (options.development_plain_text) {
    if (any) return "give either certificates or --development-plain-text";
    if (IsLoopback(host)) return "";
    return fmt::format(
        "--development-plain-text with --server '{}', expected an address of "
        "this host: 127.0.0.1, [::1] or localhost",
        options.address);
  }
  return all ? "" : "give --tls-ca, --tls-cert and --tls-key";
}

}  // namespace shiftmap::transfer

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap::transfer {

/// Where the map server is, and who the caller is.
struct ServerOptions {
  std::string address;   ///< HOST:PORT.
  std::string tls_ca;    ///< PEM file of the authority that the server's certificate is from.
  std::string tls_cert;  ///< PEM file of this vehicle's certificate.
  std::string tls_key;   ///< PEM file of its key.

  /// Without TLS, for a server on this host only.
  bool development_plain_text = false;

  double call_deadline_s = 30.0;  ///< Of a call with one answer. [s]

  /// Of a call that streams a file. What came through stays, and the next call goes on there. [s]
  double stream_deadline_s = 300.0;
};

/// The message of a usage error, or nothing: the address, and that either all three files are given
/// or plain text with an address of this host.
std::string CheckServerOptions(const ServerOptions& options);

}  // namespace shiftmap::transfer

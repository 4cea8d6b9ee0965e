// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <openssl/types.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Forgets at its end what OpenSSL noted of failures in this thread: gRPC would take them for those
/// of a connection that it serves next.
class ForgottenErrors {
 public:
  ForgottenErrors() = default;
  ~ForgottenErrors();
  ForgottenErrors(const ForgottenErrors&) = delete;
  ForgottenErrors& operator=(const ForgottenErrors&) = delete;
};

/// What a text in PEM has of a kind, in order; what follows something that does not read is left
/// out.
std::vector<std::shared_ptr<X509>> CertificatesOfPem(const std::string& pem);
std::vector<std::shared_ptr<X509_CRL>> CrlsOfPem(const std::string& pem);

/// The first private key; null if there is none, or one with a password.
std::shared_ptr<EVP_PKEY> PrivateKeyOfPem(const std::string& pem);

/// The times between which a certificate holds.
struct CertificateTimes {
  Stamp begin;
  Stamp end;
};

/// Nothing if the certificate has no times.
std::optional<CertificateTimes> TimesOf(const X509* certificate);

/// Reads certificates, as text: at least one.
/// @param kind  How messages call the file: "client CA".
/// Errors: kNotFound; kInvalidArgument if it is no certificate in PEM. Messages start with `KIND
/// 'PATH': `.
StatusOr<std::string> ReadCertificates(const std::string& kind, const std::string& path);

/// Who one end of a TLS connection is.
struct TlsIdentity {
  std::string certificates;  ///< In PEM, its own first.
  std::string key;           ///< In PEM.
  std::shared_ptr<X509> certificate;
};

/// Reads a certificate and the key that belongs to it, which gRPC would find out at each handshake
/// only.
/// @param whose  As messages call the files: "server" gives `server key 'PATH': `.
/// Errors: kNotFound; kInvalidArgument.
StatusOr<TlsIdentity> ReadTlsIdentity(const std::string& whose,
                                      const std::string& certificate_path,
                                      const std::string& key_path);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <openssl/types.h>

#include <memory>
#include <string>
#include <vector>

namespace shiftmap::server {

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

}  // namespace shiftmap::server

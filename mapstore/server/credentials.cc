// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/credentials.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <openssl/x509.h>

#include <string>
#include <vector>

#include "mapstore/core/input_file.h"
#include "mapstore/server/pem.h"

namespace shiftmap::server {
namespace {

constexpr std::size_t kMaxPemBytes = std::size_t{4} << 20;
constexpr unsigned kRefreshS = 2;

StatusOr<std::shared_ptr<X509>> ReadCertificate(const char* kind, const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string pem, ReadInputFile(kind, path, kMaxPemBytes));
  const std::vector<std::shared_ptr<X509>> certificates = CertificatesOfPem(pem);
  if (!certificates.empty()) return certificates.front();
  return InvalidArgument("{} '{}': expected a certificate in PEM", kind, path);
}

// gRPC would listen with files that do not fit, and fail every handshake.
Status CheckFiles(const TlsFiles& files) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::shared_ptr<X509> certificate,
                            ReadCertificate("server certificate", files.certificate));
  SHIFTMAP_RETURN_IF_ERROR(ReadCertificate("client CA", files.client_authority).status());
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string pem,
                            ReadInputFile("server key", files.key, kMaxPemBytes));
  const std::shared_ptr<EVP_PKEY> key = PrivateKeyOfPem(pem);
  if (!key) return InvalidArgument("server key '{}': expected a private key in PEM", files.key);
  if (X509_check_private_key(certificate.get(), key.get()) == 1) return OkStatus();
  return InvalidArgument(
      "server key '{}': does not belong to certificate '{}'", files.key, files.certificate);
}

}  // namespace

StatusOr<std::shared_ptr<grpc::ServerCredentials>> TlsCredentials(const TlsFiles& files) {
  SHIFTMAP_RETURN_IF_ERROR(CheckFiles(files));
  auto provider = std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      files.key, files.certificate, files.client_authority, kRefreshS);
  grpc::experimental::TlsServerCredentialsOptions options(provider);
  options.watch_root_certs();
  options.watch_identity_key_cert_pairs();
  options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  return grpc::experimental::TlsServerCredentials(options);
}

}  // namespace shiftmap::server

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/credentials.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>

#include "mapstore/core/pem.h"

namespace shiftmap::server {
namespace {

constexpr unsigned kRefreshS = 2;

}  // namespace

StatusOr<std::shared_ptr<grpc::ServerCredentials>> TlsCredentials(const TlsFiles& files) {
  // gRPC would listen with files that do not fit, and fail every handshake.
  SHIFTMAP_RETURN_IF_ERROR(ReadTlsIdentity("server", files.certificate, files.key).status());
  SHIFTMAP_RETURN_IF_ERROR(ReadCertificates("client CA", files.client_authority).status());
  auto provider = std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      files.key, files.certificate, files.client_authority, kRefreshS);
  grpc::experimental::TlsServerCredentialsOptions options(provider);
  options.watch_root_certs();
  options.watch_identity_key_cert_pairs();
  options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  return grpc::experimental::TlsServerCredentials(options);
}

}  // namespace shiftmap::server

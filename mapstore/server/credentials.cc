// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/credentials.h"

#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <string>

#include "mapstore/core/input_file.h"

namespace shiftmap::server {
namespace {

constexpr std::size_t kMaxPemBytes = std::size_t{4} << 20;
constexpr unsigned kRefreshS = 2;

struct FreeBio {
  void operator()(BIO* bio) const { BIO_free(bio); }
};
struct FreeX509 {
  void operator()(X509* x509) const { X509_free(x509); }
};
struct FreeKey {
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
};

StatusOr<std::unique_ptr<X509, FreeX509>> ReadCertificate(const char* kind,
                                                          const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string pem, ReadInputFile(kind, path, kMaxPemBytes));
  const std::unique_ptr<BIO, FreeBio> bio(
      BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
  std::unique_ptr<X509, FreeX509> x509(PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr));
  if (!x509) return InvalidArgument("{} '{}': expected a certificate in PEM", kind, path);
  return x509;
}

// gRPC would listen with files that do not fit, and fail every handshake.
Status CheckFiles(const TlsFiles& files) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto certificate,
                            ReadCertificate("server certificate", files.certificate));
  SHIFTMAP_RETURN_IF_ERROR(ReadCertificate("client CA", files.client_authority).status());
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string pem,
                            ReadInputFile("server key", files.key, kMaxPemBytes));
  const std::unique_ptr<BIO, FreeBio> bio(
      BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
  const auto no_password = [](char*, int, int, void*) { return 0; };
  const std::unique_ptr<EVP_PKEY, FreeKey> key(
      PEM_read_bio_PrivateKey(bio.get(), nullptr, no_password, nullptr));
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

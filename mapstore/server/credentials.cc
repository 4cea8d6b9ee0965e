// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/credentials.h"

#include <fcntl.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "mapstore/core/pem.h"

namespace shiftmap::server {
namespace {

constexpr unsigned kRefreshS = 2;

}  // namespace

Status MemoryFile::Write(const std::string& content) {
  const auto failed = [] { return Unavailable("file in memory: {}", std::strerror(errno)); };
  OwnedFd fd(memfd_create("shiftmap", MFD_CLOEXEC));
  const auto size = static_cast<ssize_t>(content.size());
  if (fd.get() < 0 || write(fd.get(), content.data(), content.size()) != size) return failed();
  if (fd_.get() < 0) {
    fd_ = std::move(fd);
  } else if (dup3(fd.get(), fd_.get(), O_CLOEXEC) < 0) {
    return failed();
  }
  return OkStatus();
}

std::string MemoryFile::path() const { return "/proc/self/fd/" + std::to_string(fd_.get()); }

StatusOr<std::unique_ptr<TlsCredentials>> TlsCredentials::Read(const TlsFiles& files,
                                                               JsonLog* log) {
  std::unique_ptr<TlsCredentials> tls(new TlsCredentials(files, log));
  SHIFTMAP_RETURN_IF_ERROR(tls->Update().status());
  auto provider = std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      tls->key_.path(), tls->certificate_.path(), tls->client_authority_.path(), kRefreshS);
  grpc::experimental::TlsServerCredentialsOptions options(provider);
  options.watch_root_certs();
  options.watch_identity_key_cert_pairs();
  options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
  tls->credentials_ = grpc::experimental::TlsServerCredentials(options);
  return tls;
}

// gRPC would take files that do not fit, and fail every handshake.
StatusOr<TlsCredentials::Content> TlsCredentials::Load() const {
  SHIFTMAP_ASSIGN_OR_RETURN(TlsIdentity identity,
                            ReadTlsIdentity("server", files_.certificate, files_.key));
  SHIFTMAP_ASSIGN_OR_RETURN(std::string authority,
                            ReadCertificates("client CA", files_.client_authority));
  return Content{std::move(identity.certificates), std::move(identity.key), std::move(authority)};
}

StatusOr<bool> TlsCredentials::Update() {
  SHIFTMAP_ASSIGN_OR_RETURN(Content content, Load());
  if (content == content_) return false;
  SHIFTMAP_RETURN_IF_ERROR(certificate_.Write(content.certificate));
  SHIFTMAP_RETURN_IF_ERROR(key_.Write(content.key));
  SHIFTMAP_RETURN_IF_ERROR(client_authority_.Write(content.client_authority));
  content_ = std::move(content);
  return true;
}

void TlsCredentials::ReloadIfChanged() {
  const StatusOr<bool> changed = Update();
  const std::string refused = changed.ok() ? "" : Message(changed.status());
  if (!refused.empty() && refused != refused_) {
    log_->Write(JsonLog::Level::kError, "certificates not taken", {{"message", refused}});
  }
  refused_ = refused;
  if (changed.ok() && *changed) {
    log_->Write(JsonLog::Level::kInfo, "certificates read", {{"path", files_.certificate}});
  }
}

}  // namespace shiftmap::server

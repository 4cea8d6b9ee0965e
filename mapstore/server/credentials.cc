// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/credentials.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "mapstore/core/pem.h"
#include "mapstore/server/file_state.h"

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

StatusOr<bool> TlsCredentials::Update() {
  const std::string state = fmt::format("{}; {}; {}",
                                        FileState(files_.certificate),
                                        FileState(files_.key),
                                        FileState(files_.client_authority));
  if (state == state_) return false;
  // gRPC would take files that do not match, and fail every handshake.
  SHIFTMAP_ASSIGN_OR_RETURN(const TlsIdentity identity,
                            ReadTlsIdentity("server", files_.certificate, files_.key));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string authority,
                            ReadCertificates("client CA", files_.client_authority));
  SHIFTMAP_RETURN_IF_ERROR(certificate_.Write(identity.certificates));
  SHIFTMAP_RETURN_IF_ERROR(key_.Write(identity.key));
  SHIFTMAP_RETURN_IF_ERROR(client_authority_.Write(authority));
  state_ = state;
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

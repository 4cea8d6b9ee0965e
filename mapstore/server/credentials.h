// SPDX-License-Identifier: Apache-2.0
//
// Inside server/ only: it is for gRPC's types.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <memory>
#include <string>

#include "mapstore/core/owned_fd.h"
#include "mapstore/server/json_log.h"
#include "mapstore/server/map_server.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// A file in memory with a path that this process can open.
class MemoryFile {
 public:
  /// Whoever opens the path gets the content before or after, whole. Errors: kUnavailable.
  Status Write(const std::string& content);

  /// Precondition: it was written.
  std::string path() const;

 private:
  OwnedFd fd_;
};

/// Mutual TLS: a client without a certificate of the authority does not get past the handshake.
/// A change of the files is loaded while the server runs. Files that cannot be read, or do not
/// match each other, are logged, and the previous ones stay in use. Threads: one, but for get().
class TlsCredentials {
 public:
  /// @param log  Must outlive this.
  /// Errors: kNotFound, kInvalidArgument if the files do not read or key and certificate do not
  /// fit; kUnavailable.
  static StatusOr<std::unique_ptr<TlsCredentials>> Read(const TlsFiles& files, JsonLog* log);

  const std::shared_ptr<grpc::ServerCredentials>& get() const { return credentials_; }

  /// Looks for changes; gRPC takes them within seconds.
  void ReloadIfChanged();

 private:
  TlsCredentials(const TlsFiles& files, JsonLog* log) : files_(files), log_(log) {}

  // Loads the files if they changed since they were last loaded. Returns whether they did.
  StatusOr<bool> Update();

  const TlsFiles files_;
  JsonLog* const log_;
  std::string state_;  // Of the files that were last loaded.
  // Their content, which gRPC watches.
  MemoryFile certificate_;
  MemoryFile key_;
  MemoryFile client_authority_;
  std::string refused_;  // Why the present files are not in use; empty: they are.
  std::shared_ptr<grpc::ServerCredentials> credentials_;
};

}  // namespace shiftmap::server

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "mapstore/map/snapshot_info.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// Signs snapshots with one Ed25519 key (RFC 8032, OpenSSL).
class SnapshotSigner {
 public:
  /// @param path  The private key in PEM, as `openssl genpkey -algorithm ed25519` writes it.
  /// Errors: kNotFound; kInvalidArgument if it is no such key. Messages start with `signing key
  /// 'PATH': `.
  static StatusOr<SnapshotSigner> Read(const std::string& path);

  SnapshotSigner(SnapshotSigner&&) noexcept;
  SnapshotSigner& operator=(SnapshotSigner&&) noexcept;
  ~SnapshotSigner();

  SnapshotSignature Sign(const SnapshotInfo& snapshot) const;

  /// As SnapshotSignature names the key.
  const std::string& key_sha256() const;

 private:
  struct Key;
  explicit SnapshotSigner(std::unique_ptr<Key> key);
  std::unique_ptr<Key> key_;
};

}  // namespace shiftmap::server

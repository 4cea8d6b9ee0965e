// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"

namespace shiftmap {

/// By one of the keys with which a site signs.
struct SnapshotSignature {
  std::string key_sha256;  ///< SHA-256 of the public key's 32 bytes, in hex.
  std::string signature;   ///< 64 bytes.
};

/// A snapshot file that a map server hands out (proto/map_server.proto, Snapshot).
struct SnapshotInfo {
  std::string area;
  VersionNumber version;
  std::string content_hash;
  LedgerPosition ledger_sequence;
  Stamp created;
  std::string sha256;  ///< Of the file, in hex.
  std::int64_t size_bytes = 0;
  std::vector<SnapshotSignature> signatures;
};

/// The text that is signed (proto/map_server.proto, SnapshotSignature).
std::string SignedText(const SnapshotInfo& snapshot);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "mapstore/map/snapshot_info.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

/// The public keys by which a vehicle believes a snapshot. While a site changes its key, there are
/// two.
class SnapshotKeys {
 public:
  /// @param paths  PEM files, an Ed25519 public key each; none: every snapshot is believed.
  /// Errors: kNotFound; kInvalidArgument for what is no such key.
  static StatusOr<SnapshotKeys> Read(const std::vector<std::string>& paths);

  /// Errors: kDataLoss if there are keys, and none of them signed the snapshot.
  Status Verify(const SnapshotInfo& snapshot) const;

 private:
  std::map<std::string, std::string> keys_;  // 32 bytes each, by their SHA-256.
};

}  // namespace shiftmap::transfer

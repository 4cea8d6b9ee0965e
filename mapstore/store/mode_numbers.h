// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "mapstore/map/landmark_group.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The mode numbers of single groups of a version. Versions are immutable, so that what was read
/// once is kept: the reports of a night name the same groups again and again.
class ModeNumbers {
 public:
  static StatusOr<ModeNumbers> Make(Database& database, std::int64_t version_id);

  std::int64_t version_id() const { return version_id_; }

  /// A group with the numbers of its modes and merged modes, and nothing else; null if the version
  /// does not have it. Valid as long as this.
  StatusOr<const LandmarkGroup*> Find(Database& database, const Signature& signature);

 private:
  explicit ModeNumbers(std::int64_t version_id) : version_id_(version_id) {}

  std::int64_t version_id_;
  std::unordered_map<Signature, std::vector<MergedMode>> merged_;
  std::unordered_map<Signature, LandmarkGroup> groups_;  // Without modes: there is no such group.
};

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/find_version.h"

#include <algorithm>

namespace shiftmap {

const VersionSummary* FindVersion(const std::vector<VersionSummary>& versions,
                                  VersionNumber version) {
  const auto found = std::find_if(versions.begin(), versions.end(), [&](const auto& other) {
    return other.version == version;
  });
  return found == versions.end() ? nullptr : &*found;
}

std::optional<VersionNumber> ParentOf(const std::vector<VersionSummary>& versions,
                                      VersionNumber version) {
  const VersionSummary* const found = FindVersion(versions, version);
  return found == nullptr ? std::nullopt : found->parent;
}

}  // namespace shiftmap

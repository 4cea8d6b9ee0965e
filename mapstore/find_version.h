// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapstore/store_types.h"

namespace shiftmap {

/// The summary of a version; null if it is not among these.
const VersionSummary* FindVersion(const std::vector<VersionSummary>& versions,
                                  VersionNumber version);

/// The version that a version was built on; nothing if it is the first, or not among these.
std::optional<VersionNumber> ParentOf(const std::vector<VersionSummary>& versions,
                                      VersionNumber version);

}  // namespace shiftmap

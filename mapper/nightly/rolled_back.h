// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// The versions of an area that somebody took back: a rollback went past them, and neither they nor
/// a descendant of theirs were published since.
/// @param audit  Entries of the area, oldest first.
std::set<VersionNumber> RolledBackVersions(const std::vector<VersionSummary>& versions,
                                           const std::vector<AuditEntry>& audit);

}  // namespace shiftmap

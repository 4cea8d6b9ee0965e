// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "mapstore/core/ids.h"

namespace shiftmap {

/// The name of a snapshot among those of its area: `<version>-<content hash>-<file hash>`, of each
/// hash the first 8 digits, e.g. `3-0a1b2c3d-4e5f6071`. The file's hash tells snapshots of one
/// version apart, whatever of the ledger they hold.
/// @param content_hash  Of the map, in hex.
/// @param sha256        Of the file, in hex; empty: a map that is not of a folder, without it.
std::string MapVersionName(VersionNumber version,
                           std::string_view content_hash,
                           std::string_view sha256);

}  // namespace shiftmap

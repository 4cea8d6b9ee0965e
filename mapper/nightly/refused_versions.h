// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapper/nightly/since_published.h"
#include "mapstore/cli/context.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The versions that were refused since the published one became that.
struct RefusedVersions {
  int count = 0;
  Stamp until = Stamp::min();  ///< When the newest run that one of them has began.
};

/// Errors: those of the store.
StatusOr<RefusedVersions> ReadRefused(const std::string& area, MapStore* store);

/// Deletes the content of refused versions (CompactVersions), but of the newest one if nothing was
/// published since: the next night's has their runs. Reasons and rows of versions stay.
/// @param store  Path; need not have the area.
/// Errors: those of the store.
Status CompactRefused(const std::string& area, const std::string& store, const Context& context);

}  // namespace shiftmap

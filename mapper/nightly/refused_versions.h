// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapper/nightly/since_published.h"
#include "mapstore/cli/context.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// When the newest run began that a version has which was refused since the published one became
/// that; Stamp::min() if there is none. Errors: those of the store.
StatusOr<Stamp> RefusedUntil(const SincePublished& since, const std::string& area, MapStore* store);

/// Deletes the content of refused versions (CompactVersions), but of the newest one if nothing was
/// published since: the next night's has their runs. Reasons and rows of versions stay.
/// @param store  Path; need not have the area.
/// Errors: those of the store.
Status CompactRefused(const std::string& area, const std::string& store, const Context& context);

}  // namespace shiftmap

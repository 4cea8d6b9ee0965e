// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/cli/context.h"
#include "mapstore/core/clock.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Opens a map store for a command. If another process holds it for noticeably long, a warning says
/// so once a wait; SHIFTMAP_LOCK_TIMEOUT_S in the environment is how long to wait, 5 s by default.
/// @param context            Must outlive the store.
/// @param clock_tolerance_s  As MapStore::OpenOptions. [s]
StatusOr<MapStore> OpenStore(const std::string& path,
                             MapStore::Access access,
                             const Context& context,
                             double clock_tolerance_s = kDefaultClockToleranceS);

}  // namespace shiftmap

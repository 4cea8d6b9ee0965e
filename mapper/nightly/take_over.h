// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapper/nightly/night_plan.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Brings what a night did to an area in a copy of a store into the store: versions with their
/// evidence, then, in their order, what waits, was refused, held and published. What is there
/// already is left as it is.
/// Errors: kAborted if the store has other versions since the copy was made, or another one is
/// published; those of both stores.
Status TakeOver(const std::string& area, const AreaBase& base, MapStore* from, MapStore* to);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapper/nightly/night.h"
#include "mapstore/cli/context.h"

namespace shiftmap {

/// What `shiftmap-mapper nightly --json` says of an area.
Json AreaNightJson(const AreaNight& night);

/// The whole document.
Json NightJson(const NightResult& result);

/// The same for people.
std::string NightText(const NightResult& result);

}  // namespace shiftmap

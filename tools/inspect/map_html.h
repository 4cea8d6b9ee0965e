// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "mapstore/map_store.h"
#include "proto/core/status.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {

/// The page of the web view with the map that the arguments name: one file that works offline.
/// @param replay  A file that `shiftmap-localizer run --recording` wrote.
/// Errors: those of MapDocument() and ViewPage().
StatusOr<std::string> MapHtml(const StoreArguments& arguments,
                              const std::optional<std::string>& replay,
                              MapStore* store);

}  // namespace shiftmap

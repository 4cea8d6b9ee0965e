// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "mapstore/cli/context.h"
#include "proto/core/status.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {

/// The page of the web view with the map that the arguments name: one file that works offline.
/// @param replay  A file that `shiftmap-localizer run --recording` wrote.
/// Errors also: kFailedPrecondition if this build has no web view.
StatusOr<std::string> MapHtml(const StoreArguments& arguments,
                              const std::optional<std::string>& replay,
                              const Context& context);

}  // namespace shiftmap

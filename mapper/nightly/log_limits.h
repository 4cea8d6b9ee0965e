// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapper/nightly/night.h"
#include "mapper/nightly/night_options.h"
#include "mapstore/cli/context.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Deletes logs that are in a published map, or that somebody excluded, the oldest first: those
/// beyond the age, then as many as the quota asks for. What no map has stays, and where a limit
/// cannot be kept without it a line of `work->left` says so. Returns the paths of what was deleted,
/// or in a dry run, which changes nothing, would be if the night mapped nothing.
///
/// The age of a log is that of its file, its place in the order the begin of its run.
/// Errors: those of the store; kUnavailable if a file cannot be deleted.
StatusOr<std::vector<std::string>> KeepLogLimits(const NightOptions& options,
                                                 const Context& context,
                                                 NightWork* work);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "mapstore/cli/context.h"
#include "proto/core/status.h"
#include "tools/view/compact_values.h"

namespace shiftmap {

struct ReplayOptions {
  std::size_t max_steps = 20'000;  ///< Poses of a longer shift are thinned.
  std::size_t max_hypotheses = 5;  ///< The heaviest of each sample.
};

/// A shift that `shiftmap-localizer run --recording` recorded, for the page.
/// @param area  That the shift must be of.
/// Errors: those of ReadShiftRecording; kInvalidArgument if the shift is of another area, or has no
/// pose.
StatusOr<Json> ReplayJson(const std::string& path,
                          const std::string& area,
                          const ReplayOptions& options,
                          TextTable* signatures);

}  // namespace shiftmap

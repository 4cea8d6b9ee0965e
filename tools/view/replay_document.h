// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "mapstore/cli/context.h"
#include "mapstore/core/ids.h"
#include "mapstore/geometry/se2.h"
#include "proto/core/status.h"
#include "tools/view/compact_values.h"

namespace shiftmap {

struct ReplayOptions {
  /// T_shown_version of earlier versions that a shift may have driven on; others lie as the one
  /// that is shown.
  std::map<VersionNumber, Se2> frames = {};

  /// Former names of landmarks, each with that of the version that is shown.
  std::map<Signature, Signature> aliases = {};
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

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "mapper/cli/area_build.h"

namespace shiftmap {

/// What the store keeps of how a version was made: the options, the runs with thinned trajectories,
/// and what became of them.
/// @param in_logs  Observations of each log as it is in its file, by its SHA-256.
Provenance MakeProvenance(const AreaBuildOptions& options,
                          const AreaBuild& build,
                          const std::map<std::string, std::int64_t>& in_logs);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/build_progress.h"
#include "mapper/mapper_options.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/state/build_state.h"
#include "mapper/state/undecided_runs.h"
#include "mapstore/core/ids.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Starts the common build with the runs in one frame (PlaceRunMaps), by begin. It has no run if
/// all that are left wait.
/// @param signatures  Of the groups, ascending.
/// Errors: kInvalidArgument if no run is left; kCancelled.
StatusOr<BuildState> PlaceRuns(std::vector<RunMap> run_maps,
                               const std::vector<Signature>& signatures,
                               const std::optional<MapContent>& prior,
                               const MapperOptions& options,
                               BuildWatch* watch,
                               std::vector<RejectedRun>* rejected);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/mapper_options.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/state/build_state.h"
#include "mapper/state/undecided_runs.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// Places run maps one after the other, always the one that shares most signatures with what is
/// there, and adds them to the build. Whenever the runs in the map are twice as many as the last
/// time, from four on, and once more when some are left that do not align, what is there is solved
/// as a whole (UpdateModes). One that does not align is tried again once the map has
/// other modes of its signatures. A mode of a run map becomes one that is there, or a mode beside
/// it:
///
/// - against modes of the prior map that is decided for the whole run map at once, FindDisplaced(),
///   and a run map waits for which that has no likely result;
/// - against modes that other runs of this build brought, by a gate on each.
///
/// A run map of which few landmarks agree is placed only where Explain() decides for one frame
/// (ConfirmationOptions). Else it waits. Run maps that remain are joined with each other where they
/// agree; without a prior map the largest joined map is kept. The others are tried once more, each
/// as one run map. BuildState::waiting gets those with several explanations.
///
/// Where the frame is decided, but not which landmarks stayed in it, those in doubt get a mode
/// beside the one that they may have left (BuildState::kept).
///
/// Rejects run maps that do not align, or that share fewer than two unmoved landmarks.
/// @param on_step  Asked before each run map; if it says no, the others are neither placed nor
/// rejected.
void PlaceRunMaps(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  std::vector<RunMap> run_maps,
                  BuildState* build,
                  std::vector<RejectedRun>* rejected,
                  const StepCallback& on_step = {});

}  // namespace shiftmap

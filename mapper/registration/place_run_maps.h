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
/// (ConfirmationOptions). Else it waits. What is left in the end is joined where it agrees with
/// itself, without a prior map the largest such map is the one, and the others are tried once more
/// as one run map each. BuildState::waiting is what has several explanations then.
///
/// Where the frame is decided, but not which landmarks stayed in it, those in doubt get a mode
/// beside the one that they may have left (BuildState::kept).
///
/// What aligns with nothing is rejected, and so is what the landmarks that moved leave without two
/// that did not.
/// @param on_step  Asked before each run map; if it says no, the others are neither placed nor
/// rejected.
void PlaceRunMaps(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  std::vector<RunMap> run_maps,
                  BuildState* build,
                  std::vector<RejectedRun>* rejected,
                  const StepCallback& on_step = {});

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"
#include "mapper/problem/rejected_run.h"
#include "mapper/submaps/submap.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// Places submaps one after the other, always the one that shares most signatures with what is
/// there, and adds them to the problem. Whenever the runs in the map are twice as many as the last
/// time, from four on, and once more when some are left that do not align, what is there is solved
/// as a whole (SettleModes). One that does not align is tried again once the map has
/// other modes of its signatures. A mode of a submap becomes one that is there, or a mode beside
/// it:
///
/// - against modes of the prior map that is decided for the whole submap at once, FindDisplaced();
/// - against modes that other runs of this build brought, by a gate on each.
///
/// A submap of which few landmarks agree is placed only where Explain() decides for one frame
/// (ConfirmationOptions). Else it waits. What is left in the end is joined where it agrees with
/// itself, without a prior map the largest such map is the one, and the others are tried once more
/// as one submap each. MapProblem::waiting is what has several explanations then.
///
/// What aligns with nothing is rejected, and so is what the landmarks that moved leave without two
/// that did not.
/// @param go_on  Asked before each submap; if it says no, the others are neither placed nor
/// rejected.
void PlaceSubmaps(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  std::vector<Submap> submaps,
                  MapProblem* problem,
                  std::vector<RejectedRun>* rejected,
                  const GoOn& go_on = {});

}  // namespace shiftmap

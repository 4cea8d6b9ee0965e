// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/frontend/mapping_run.h"

namespace shiftmap {

/// The visits of landmarks that move while they are in view, ascending: codes on this vehicle or on
/// another one. A landmark that is seen twice, after a way by which it must be seen two metres
/// elsewhere in the vehicle frame, is not where odometry has it by half of that, again and again,
/// and of the others that are in view meanwhile as many are, also by odometry as these have it
/// (CalibrateFromPairs). So wheels that slip, odometry of another scale and vehicles that are
/// carried make none.
std::vector<VisitIndex> FindMovingVisits(const MappingRun& run, const MovingVisitOptions& options);

}  // namespace shiftmap

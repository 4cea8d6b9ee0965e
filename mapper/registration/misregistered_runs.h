// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Puts runs back that lay a second map beside that of the others, or beside a part of it: in which
/// visit after visit, at least some in a row, or as many landmarks are known at another place, some
/// of them displaced together. Landmarks that moved stand among others that did not, and went each
/// its own way.
///
/// Such a run is pulled to where the others have its landmarks, whatever that bends: what two runs
/// say of a hall far away differs by metres, and no rigid transform joins them. If its visits are
/// in a row, it is also mapped in parts, each is aligned with what the others have, and what lies
/// between goes on by odometry. Either stays if more of its visits are then where the others have
/// their landmark, and the run costs less with theirs held; a run that is pulled must also fit. Its
/// other visits are left unassigned, and nothing is solved. Returns how many runs were put back.
int RelocateMisregisteredRuns(const MapperOptions& options,
                              BuildState* build,
                              const StepCallback& on_step = {});

}  // namespace shiftmap

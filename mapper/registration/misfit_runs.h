// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "mapper/state/undecided_runs.h"

namespace shiftmap {

/// Compares the fit of a run of a joint map with that of the run by itself (mapper/METHOD.md, 6).
///
/// Nothing is returned for a run that shares fewer than three modes with the others and the prior
/// map, which have no shape, or that has more than ConfirmationOptions::max_modes.
/// @param build  Solved, with the noise that runs by themselves have.
std::optional<JoinedFit> FitJoined(const MapperOptions& options,
                                   const BuildState& build,
                                   RunIndex run);

/// Takes out a run, and runs that it alone constrained (RemoveUnconstrainedRuns). Nothing is
/// solved. Returns its entry of BuildState::waiting, which is valid until another run waits.
WaitingRuns& LetWait(RunIndex run, BuildState* build);

/// Lets the run wait that fits worst of those that do not fit. Returns false if all fit.
bool RemoveMisfitRun(const MapperOptions& options, BuildState* build);

}  // namespace shiftmap

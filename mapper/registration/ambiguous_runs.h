// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Lets a run wait (LetWait) of which it is not decided which landmarks moved, as of a hall that
/// nothing else holds: that those stayed that other runs of the build have elsewhere costs less
/// than kModeCost more. Of several, the run of which it costs least. Runs of more than
/// ConfirmationOptions::max_modes count as decided, and those of which no landmarks are displaced
/// together. Nothing is solved. Returns false if all are.
bool RemoveAmbiguousRun(const MapperOptions& options,
                        BuildState* build,
                        const StepCallback& on_step = {});

}  // namespace shiftmap

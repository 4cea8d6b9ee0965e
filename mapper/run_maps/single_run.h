// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "mapper/frontend/mapping_run.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Maps one run by itself, in the frame of its first key frame.
/// @param groups  Of all runs; the visits' group indices are below.
/// @param on_step  If it says no, the build is left as far as it is.
/// Precondition: the run has a sighting.
BuildState MapSingleRun(const MappingRun& run,
                        std::size_t groups,
                        const MapperOptions& options,
                        const StepCallback& on_step = {});

/// Maps a part of a run that was mapped before, with the calibration of the run.
/// @param build  Whose groups and sensor it has.
BuildState MapPart(const MapperOptions& options,
                   const BuildState& build,
                   const BuildRun& run,
                   const MappingRun& part,
                   const StepCallback& on_step = {});

/// Solves the poses of a build of one run with a loss that is square for metres first, so that what
/// is far off pulls.
void PullTogether(const MapperOptions& options, BuildState* build);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "mapper/frontend/mapping_run.h"
#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"

namespace shiftmap {

/// Maps one run by itself, in the frame of its first key frame.
/// @param groups  Of all runs; the visits' group indices are below.
/// @param go_on  If it says no, the problem is left as far as it is.
/// Precondition: the run has a sighting.
MapProblem MapSingleRun(const MappingRun& run,
                        std::size_t groups,
                        const MapperOptions& options,
                        const GoOn& go_on = {});

/// Maps a part of a run that was mapped before, with the calibration of the run.
/// @param problem  Whose groups and sensor it has.
MapProblem MapPart(const MapperOptions& options,
                   const MapProblem& problem,
                   const BuildRun& run,
                   const MappingRun& part,
                   const GoOn& go_on = {});

}  // namespace shiftmap

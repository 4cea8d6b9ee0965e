// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/map_problem.h"
#include "mapper/mapper_options.h"

namespace shiftmap {

/// Gives the runs of each vehicle one odometry noise: the median of theirs. What a run says of it
/// by itself is little.
void PoolNoiseByVehicle(MapProblem* problem);

/// Finds the noise of the sensor and of each vehicle's odometry from the residuals of solved
/// graphs: each variance is multiplied by what its residuals have too much or too little (variance
/// components, README: noise), and the problem is solved again, until they stay.
/// @param rounds  At most.
void CalibrateNoise(const MapperOptions& options,
                    int rounds,
                    MapProblem* problem,
                    const GoOn& go_on = {});

}  // namespace shiftmap

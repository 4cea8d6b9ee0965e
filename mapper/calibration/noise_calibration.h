// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Gives the runs of each vehicle one odometry noise: the median of theirs. What a run says of it
/// by itself is little.
void PoolNoiseByVehicle(BuildState* build);

/// Gives each run mapped by itself at least the odometry noise that its vehicle has in the median
/// of its runs: one that is too sure of itself ties to less of a map than it saw.
void RaiseNoiseByVehicle(std::vector<BuildState>* single_runs);

/// How long noise is looked for.
struct NoiseRounds {
  int most = 3;

  /// Noise within this factor of what residuals say is right enough: a run of a thousand residuals
  /// says no more.
  double settled = 1.05;
};

/// As SolveOnce(), in a few steps: what goes on from there need not be at the minimum.
Graph SolveTruncated(const MapperOptions& options,
                     int steps,
                     BuildState* build,
                     GraphSolver* solver);

/// Finds the noise of the sensor and of each vehicle's odometry from the residuals of solved
/// graphs: each variance is multiplied by what its residuals have too much or too little (variance
/// components, mapper/METHOD.md, 5; Förstner: Ein Verfahren zur Schätzung von Varianz- und
/// Kovarianzkomponenten, 1979), and the build is solved again, until they stay.
/// After the last change it is not. Precondition: the build is solved, if roughly.
/// @param solver  What it keeps goes on from and to other solves of this build.
void CalibrateNoise(const MapperOptions& options,
                    const NoiseRounds& rounds,
                    BuildState* build,
                    GraphSolver* solver,
                    const StepCallback& on_step = {});

}  // namespace shiftmap

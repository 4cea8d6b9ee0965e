// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/graph/graph.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Functions that are fitted at a time: each takes as much memory as all residuals and all
/// unknowns.
inline constexpr int kFunctionsAtOnce = 4;

/// Solves a build with the distortions of its vehicles' sensors, BuildRun::distortion, taken off
/// its observations. These are estimated anew; without calibration or with a share of 0 there are
/// none.
///
/// The distortions are additional unknowns, from which the solved graph is eliminated. Functions of
/// range and bearing are orthonormal over the observations of a vehicle, and each has the prior
/// standard deviation s. With Φ the standardized residuals that they lead to, and the residuals e:
///
///   Λ = Φᵀ (I - J H⁻¹ Jᵀ) Φ + s⁻² I,   a = Λ⁻¹ Φᵀ e,   R = H⁻¹ Jᵀ Φ Λ^(-1/2)
///
/// R is BuildState::distortion_root. The variance MapperOptions::distortion_share², over that of
/// the noise, is divided among the functions. These are the polynomials of second degree,
/// orthogonal to the errors in SensorBias, each combined with the scale of ranges such that the
/// size of the map stays: no run observes it.
/// @param solver  What it keeps goes on from and to other solves of this build.
void SolveWithDistortions(const MapperOptions& options, BuildState* build, GraphSolver* solver);

/// The same, and what the solver keeps is of no use.
void SolveWithDistortions(const MapperOptions& options, BuildState* build);

/// Forgets the distortions of a build.
void DropDistortions(BuildState* build);

}  // namespace shiftmap

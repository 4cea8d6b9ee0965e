// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/graph/graph.h"
#include "mapper/graph/graph_posterior.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Functions of a vehicle's sensor at most, and of all alike.
inline constexpr int kErrorFunctions = 10;
inline constexpr int kCommonErrorFunctions = 1;

/// Estimates the distortions of the sensors of a build's vehicles, BuildRun::distortion. Without
/// calibration or with a share of 0, or where they are not determined, there are none: false.
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
/// @param graph      Of the build, solved without distortions.
/// @param posterior  Of the graph.
bool EstimateDistortions(const MapperOptions& options,
                         const Graph& graph,
                         const GraphPosterior& posterior,
                         BuildState* build);

/// Solves a build with its distortions, which are estimated anew, taken off its observations.
/// @param solver  What it keeps goes on from and to other solves of this build.
void SolveWithDistortions(const MapperOptions& options, BuildState* build, GraphSolver* solver);

/// The same, and what the solver keeps is of no use.
void SolveWithDistortions(const MapperOptions& options, BuildState* build);

/// Forgets the distortions of a build.
void DropDistortions(BuildState* build);

}  // namespace shiftmap

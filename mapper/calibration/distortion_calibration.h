// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapper/graph/graph_posterior.h"
#include "mapper/graph/sensor_distortion.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Functions that are fitted at a time: each takes as much memory as all residuals and all
/// unknowns.
inline constexpr int kFunctionsAtOnce = 4;

/// What a build says of the distortions of its vehicles' sensors.
struct Distortions {
  /// Those of a vehicle are alike.
  IndexedVector<RunIndex, SensorDistortion> of_runs;

  /// R, two rows a mode: what is unknown of the distortions adds R Rᵀ to the covariance of the
  /// modes. [m]
  Eigen::MatrixXd mode_root;
};

/// The distortions as unknowns beside those of a solved graph. With Φ the standardized residuals
/// that functions orthonormal over a vehicle's observations lead to, each with the prior standard
/// deviation s, and the residuals e:
///
///   Λ = Φᵀ (I - J H⁻¹ Jᵀ) Φ + s⁻² I,   a = Λ⁻¹ Φᵀ e,   R = H⁻¹ Jᵀ Φ Λ^(-1/2)
///
/// s² is the share of the noise's variance, MapperOptions::distortion_share², divided among the
/// functions: the polynomials of second degree without the errors that SensorBias has. What makes
/// the map grow is left to the scale of ranges, which no run tells: the map's scale stays.
/// Without calibration, or with a share of 0: none.
/// @param graph      Of the build, solved.
/// @param posterior  Of the graph.
Distortions EstimateDistortions(const MapperOptions& options,
                                const Graph& graph,
                                const GraphPosterior& posterior,
                                const BuildState& build);

/// Solves a build, sets the distortion of each run, BuildState::distortion_root, and solves it
/// again.
/// @param solver  What it keeps goes on from and to other solves of this build.
void CalibrateDistortions(const MapperOptions& options, BuildState* build, GraphSolver* solver);

}  // namespace shiftmap

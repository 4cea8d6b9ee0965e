// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "mapper/graph/graph.h"
#include "tools/experiment/incremental/fixed_lag_smoother.h"

namespace shiftmap::testing {

/// A loss that is the square: the smoother's Cauchy loss is the bare one, the graph's is
/// normalized.
inline constexpr double kNoLoss = 1e3;

struct SiteShape {
  int frames = 60;
  int modes = 6;
  double noise = 1.0;       ///< Times the noise that the graph is told.
  bool surveyed = true;     ///< The graph has a prior of all modes.
  double start_sd = 1e3;    ///< Of the first pose: x, y [m] and yaw [rad].
  bool calibrated = false;  ///< The calibration is known.
};

/// A vehicle on a circle among modes that it sees when they are near, as a graph of one run with
/// every observation at its true mode; poses and modes as the noise has them.
Graph MakeSmallSite(const SiteShape& shape, std::uint64_t seed);

/// The first pose of a site with the uncertainty of its shape.
PoseWithCovariance StartOf(const SiteShape& shape, const Graph& graph);

/// Options that take the priors of the graph's run.
SmootherOptions OptionsOf(const Graph& graph);

/// Gives a smoother the modes of the graph and their prior.
void AddModes(const Graph& graph, FixedLagSmoother* smoother);

/// Gives a smoother the next frame of the graph with all that is seen from it.
void AddNextFrame(const Graph& graph, int frame, FixedLagSmoother* smoother);

}  // namespace shiftmap::testing

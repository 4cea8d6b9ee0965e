// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"

namespace shiftmap {

/// A run mapped by itself, waiting for its place in the common frame.
struct Submap {
  MapProblem problem;
  std::vector<AlignmentPoint> points;  ///< Its modes, in the flat order of the problem.
  Eigen::MatrixXd covariance;          ///< Joint, of the points, relative to them as a whole. [m²]
};

/// Standard deviation per axis of the mode that a submap knows worst against the others; 0 if it
/// has none. [m]
double WorstSd(const Submap& submap);

/// The covariance of a submap's modes, as Submap::covariance, at their present values. Nothing if
/// these have gone astray so far that there is none.
std::optional<Eigen::MatrixXd> SubmapCovariance(const MapperOptions& options, MapProblem* problem);

/// Nothing if the run does not determine its own landmarks.
/// @param problem  As MapSingleRun() leaves it.
std::optional<Submap> MakeSubmap(const MapperOptions& options, MapProblem problem);

}  // namespace shiftmap

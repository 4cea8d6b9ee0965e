// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"

namespace shiftmap {

/// A run mapped by itself, or several that agree with each other in one frame, waiting for a place
/// in the map.
struct Submap {
  MapProblem problem;
  std::vector<AlignmentPoint> points;  ///< Its modes, in the flat order of the problem.
  Eigen::MatrixXd covariance;          ///< Joint, of the points, relative to them as a whole. [m²]
};

/// Standard deviation per axis of the mode that a submap knows worst against the others; 0 if it
/// has none. [m]
double WorstSd(const Submap& submap);

/// Whether a submap is known so well that its covariance, which is linear, says how it may differ
/// from the map.
bool IsStiff(const Submap& submap);

/// The covariance of a submap's modes, as Submap::covariance, at their present values. Nothing if
/// these have gone astray so far that there is none.
std::optional<Eigen::MatrixXd> SubmapCovariance(const MapperOptions& options, MapProblem* problem);

/// The same of some modes, relative to these as a whole. Where they are few this costs little more
/// than the factor.
/// @param modes  Flat indices.
std::optional<Eigen::MatrixXd> CovarianceOfModes(const MapperOptions& options,
                                                 const std::vector<int>& modes,
                                                 MapProblem* problem);

/// Nothing if the runs do not determine their own landmarks.
/// @param problem  Solved, as MapSingleRun() leaves it.
std::optional<Submap> MakeSubmap(const MapperOptions& options, MapProblem problem);

}  // namespace shiftmap

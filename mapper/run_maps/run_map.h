// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// A run mapped by itself, or several that agree with each other in one frame, waiting for a place
/// in the map.
struct RunMap {
  BuildState build;
  AlignmentPoints points;      ///< Its modes.
  Eigen::MatrixXd covariance;  ///< Joint, of the points, relative to them as a whole. [m²]
};

/// Standard deviation per axis of the mode that a run map knows worst against the others; 0 if it
/// has none. [m]
double WorstSd(const RunMap& run_map);

/// Whether a run map is known so well that its covariance, which is linear, says how it may differ
/// from the map.
bool IsStiff(const RunMap& run_map, const DeformationOptions& options);

/// The covariance of a run map's modes, as RunMap::covariance, at their present values. Nothing if
/// these have diverged so far that there is none.
std::optional<Eigen::MatrixXd> RunMapCovariance(const MapperOptions& options, BuildState* build);

/// The same of some modes, relative to these as a whole. Where they are few this costs little more
/// than the factor.
std::optional<Eigen::MatrixXd> CovarianceOfModes(const MapperOptions& options,
                                                 const std::vector<ModeIndex>& modes,
                                                 BuildState* build);

/// Nothing if the runs do not determine their own landmarks.
/// @param build  Solved, as MapSingleRun() leaves it.
std::optional<RunMap> MakeRunMap(const MapperOptions& options, BuildState build);

/// The same, with the distortions of its sensors taken off (EstimateDistortions) if it is stiff. In
/// a longer run the errors of its odometry are far larger.
/// @param build  Without distortions; its noise may have changed since it was solved.
std::optional<RunMap> MakeUndistortedRunMap(const MapperOptions& options, BuildState build);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Modes that hold a run in the map: one would leave it free to turn about it.
inline constexpr int kMinTyingModes = 2;

/// Why a run that fewer hold is rejected.
inline constexpr char kUnconstrainedReason[] = "too few landmarks stand where the map has them";

/// Takes out runs that nothing ties to the others: selection has left too few of their landmarks
/// where the map has them, and a graph with them is not determined. A run is tied by kMinTyingModes
/// that the prior map or runs tied before have; without a prior map the most runs that are tied to
/// each other stay. Modes that no other run has go with them. What is taken out is added to
/// BuildState::left_out. Returns how many runs that are.
int RemoveUnconstrainedRuns(BuildState* build);

/// Why a run none of whose observations is at a mode is left out.
inline constexpr char kOutliersReason[] =
    "all its observations are outliers: they are in another unit, or not of its odometry";

/// Takes out runs without a mode: they have nothing in the map. Otherwise as
/// RemoveUnconstrainedRuns(), which leaves one run by itself as it is.
int RemoveRunsOfOutliers(BuildState* build);

/// The same, and an error (kInvalidArgument) if no run is left then and none waits.
Status RemoveRunsOfNoMode(BuildState* build);

/// Takes out what others that were taken out leave untied, and runs without a mode. Errors: the
/// same.
Status RemoveUntiedRuns(BuildState* build);

/// Why a run whose modes take too much memory is left out.
inline constexpr char kTooLargeReason[] = "its landmarks take too much memory";

/// Takes out the run with the most modes that no other run has, and those modes. Returns false for
/// a build of one run, which stays.
bool RemoveRunWithMostModes(BuildState* build);

/// Why a run that would not be a map by itself is rejected.
inline constexpr char kUndeterminedReason[] = "its sightings do not determine its landmarks";

/// Takes out runs that by themselves do not determine where their landmarks are (LinearizeForMap,
/// IsDetermined), as where the values of a log are beyond what a computer can solve for: for a
/// build of which that is true as a whole. Otherwise as RemoveUnconstrainedRuns().
int RemoveUndeterminedRuns(const MapperOptions& options, BuildState* build);

/// Takes out runs of a calibration that no vehicle has (ImplausibleCalibration), as some come to
/// only together with others. Otherwise as RemoveUnconstrainedRuns().
int RemoveImplausibleRuns(const PlausibilityOptions& options, BuildState* build);

}  // namespace shiftmap

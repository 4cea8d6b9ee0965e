// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

struct TrajectoryErrorOptions {
  /// Move the estimate onto the truth by the best rigid transform first: for an estimate in a frame
  /// of its own.
  bool align = false;

  /// An estimate between two poses of the truth that are further apart than this is not matched.
  double max_gap_s = 1.0;
};

/// How far a trajectory is from the truth, over the poses that the truth covers.
struct TrajectoryError {
  int matched = 0;
  int unmatched = 0;  ///< Estimated poses at times that the truth does not cover.
  double position_rmse_m = 0.0;
  double position_mean_m = 0.0;
  double position_median_m = 0.0;
  double position_p95_m = 0.0;
  double position_max_m = 0.0;
  double yaw_rmse_rad = 0.0;
  Se2 T_truth_estimate;  ///< The alignment that was applied; identity without.
};

/// Compares an estimate with the truth interpolated to its stamps.
/// Errors: kInvalidArgument if no pose matches, or the alignment is undefined.
StatusOr<TrajectoryError> EvaluateTrajectory(std::span<const StampedPose> estimate,
                                             std::span<const StampedPose> truth,
                                             const TrajectoryErrorOptions& options);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
//
// True motions between pairs of poses, and a trajectory's error against them: Kümmerle et al., "On
// measuring the accuracy of SLAM algorithms", Autonomous Robots 27(4), 2009. Nothing is aligned: an
// error counts where it is made, and not for all that follows.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

struct PoseRelation {
  Stamp a;
  Stamp b;
  Se2 T_a_b;
};

/// Reads rows `time_a time_b x y z roll pitch yaw`, seconds, metres and radians.
/// Errors: kNotFound; kUnavailable if the file cannot be read; kInvalidArgument, as
/// `<file>:<line>: ...`, for a row that is malformed or not in the plane.
StatusOr<std::vector<PoseRelation>> ReadPoseRelations(const std::string& path);

/// What a true trajectory says of each pose and the one `lag` poses later. @param lag  >= 1.
std::vector<PoseRelation> RelationsAlong(std::span<const StampedPose> trajectory, std::size_t lag);

struct RelationError {
  int matched = 0;  ///< Relations between times at which the trajectory has poses.

  // Of T_a_b⁻¹ · (the trajectory's T_a_b): length of its translation, size of its rotation.
  double translation_mean_m = 0.0;
  double translation_sd_m = 0.0;
  double translation_mean_square_m2 = 0.0;
  double rotation_mean_rad = 0.0;
  double rotation_sd_rad = 0.0;
  double rotation_mean_square_rad2 = 0.0;
};

/// Poses match if their stamps are equal to a microsecond.
/// @param trajectory  By stamp.
/// Errors: kInvalidArgument if no relation matches.
StatusOr<RelationError> EvaluateRelations(std::span<const StampedPose> trajectory,
                                          std::span<const PoseRelation> relations);

}  // namespace shiftmap

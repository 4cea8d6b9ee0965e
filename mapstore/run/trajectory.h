// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/geometry/se2.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Where a vehicle was at one time.
struct StampedPose {
  Stamp stamp;
  Se2 T_map_vehicle;
};

/// Reads a TUM trajectory: lines `t x y z qx qy qz qw`, seconds since the epoch and metres; empty
/// lines and lines that start with `#` are skipped. Stamps are rounded to microseconds.
/// Errors: kNotFound if there is no such file; kInvalidArgument, with `<path>:<line>`, for a line
/// that is malformed, not in the plane (z, qx or qy above 1e-6), not within 146 years of 1970, or
/// goes backwards in time.
StatusOr<std::vector<StampedPose>> ReadTum(const std::string& path);

/// Writes a TUM trajectory with stamps in microseconds; every other number survives a round trip.
/// The file appears whole or not at all. Errors: as AtomicFile.
Status WriteTum(std::span<const StampedPose> trajectory, const std::string& path);

/// The pose at `stamp`, on the arc of constant twist between the two poses around it.
/// @param trajectory  By non-decreasing stamp.
/// @param max_gap     Nothing is returned between poses that are further apart than this, and
///                    before the first and after the last pose.
std::optional<Se2> Interpolate(std::span<const StampedPose> trajectory,
                               Stamp stamp,
                               Duration max_gap);

/// The same point in two frames. [m]
struct PointPair {
  Eigen::Vector2d p_a = Eigen::Vector2d::Zero();
  Eigen::Vector2d p_b = Eigen::Vector2d::Zero();
};

/// The rigid transform T_a_b that minimizes Σ |p_a - T_a_b p_b|², in closed form (Umeyama, PAMI
/// 1991, in the plane and without scale): rotation from the summed dot and cross products of the
/// centred points.
/// Errors: kInvalidArgument for fewer than two pairs, or if the points of one frame coincide: the
/// rotation is undefined then.
StatusOr<Se2> AlignRigid2d(std::span<const PointPair> pairs);

}  // namespace shiftmap

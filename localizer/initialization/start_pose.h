// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/geometry/covariance.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Farther from the map's origin than any frame of a planet puts a place. [m]
inline constexpr double kMaxStartDistanceM = 1e8;

/// Least and most that a start may leave open: beyond them it says more than anybody can know, or
/// nothing. Standard deviations. [m], [rad]
inline constexpr double kMinStartSd = 1e-6;
inline constexpr double kMaxStartPositionSdM = 1000.0;
inline constexpr double kMaxStartYawSdRad = 3.1416;

/// Checks a pose to start from: coordinates within ±kMaxStartDistanceM, a covariance that is
/// symmetric positive definite, with standard deviations within the bounds above.
/// Errors: kInvalidArgument with the values.
Status ValidateStart(const PoseWithCovariance& pose);

/// Whether two estimates of one pose contradict each other: their distance is beyond the 0.999
/// quantile of what their covariances, taken as independent, allow.
bool ClearlyApart(const PoseWithCovariance& a, const PoseWithCovariance& b);

/// Whether one does not stand for the other: the same with the 0.95 quantile.
bool Apart(const PoseWithCovariance& a, const PoseWithCovariance& b);

}  // namespace shiftmap

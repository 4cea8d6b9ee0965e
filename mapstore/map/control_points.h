// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A surveyed position of a mode, in the frame that the map is to have.
struct ControlPoint {
  Signature signature;
  ModeNumber mode;
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();  ///< [m]
  double sd_m = 0.0;                                         ///< Per axis. [m]
};

/// Conditions a map on control points, by generalized least squares. The map's frame is free: it
/// moves to where the points say, and the modes' shape takes up what is left. With R = diag(sd²), H
/// the points' modes and G the frame's directions at them
///
///   W = R⁻¹ - R⁻¹G (GᵀR⁻¹G)⁻¹ GᵀR⁻¹,  P' = (P⁻¹ + Hᵀ (W - W_known) H)⁻¹
///
/// where W_known is that of the points which P knows of: points one at a time, in any order, give
/// what all at once give, to the first order in the shape's change over the points' distances.
///
/// Points tell the frame's rotation if they are two or more and know it to 0.05 rad, else its
/// translation only. One point by itself only moves the frame. Points of modes that the map does
/// not have are left out; one of a mode that a build merged holds the mode that stands for it.
/// @param known  So many of the points, the first, the map's covariance knows of. A map of more
///               than kMaxJointModes modes knows of none: its covariance stays.
/// @return T_new_old of the frame.
Se2 HoldControlPoints(const std::vector<ControlPoint>& points,
                      std::size_t known,
                      MapContent* content);

/// Whether control points fit each other and the map, as HoldControlPoints takes them: rᵀ Q r is
/// chi-square, with the degrees of freedom that the frame leaves, if map and points are as good as
/// they say. The bound leaves room for a map of 1.5 times the variance that it states.
/// Errors: kInvalidArgument, which names the point without which the others fit best.
Status CheckControlPoints(const std::vector<ControlPoint>& points, const MapContent& content);

/// The points that a map can be held on: all that fit, or all but the one that contradicts, where
/// the others fit without that one alone. None where nobody knows which one is wrong.
std::vector<ControlPoint> FittingControlPoints(const std::vector<ControlPoint>& points,
                                               const MapContent& content);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
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
/// moves to where the points say, and the modes' shape takes up what is left:
///
///   M = H P Hᵀ + diag(sd²)          Gc = the frame's directions at the points
///   frame  f = (GcᵀM⁻¹Gc)⁻¹ GcᵀM⁻¹ r
///   shape  Δ = P Hᵀ Q r,  P' = P - P Hᵀ Q H P,  Q = M⁻¹ - M⁻¹Gc (GcᵀM⁻¹Gc)⁻¹ GcᵀM⁻¹
///
/// Points tell the frame's rotation if they are two or more and know it to 0.05 rad, else its
/// translation only. One point by itself only moves the frame. Points of modes that the map does
/// not have are left out; one of a merged mode holds the mode that stands for it.
/// @param inform  False: the map's covariance knows of the points already, and stays.
/// @return T_new_old of the frame. Determinism: the order of `points` matters in rounding only.
Se2 HoldControlPoints(const std::vector<ControlPoint>& points, bool inform, MapContent* content);

/// Whether control points fit each other and the map, as HoldControlPoints takes them: rᵀ Q r is
/// chi-square, with the degrees of freedom that the frame leaves, if map and points are as good as
/// they say. The bound leaves room for a map of 1.5 times the variance that it states.
/// Errors: kInvalidArgument, which names the point without which the others fit best.
Status CheckControlPoints(const std::vector<ControlPoint>& points, const MapContent& content);

}  // namespace shiftmap

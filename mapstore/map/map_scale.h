// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// What a map's scale is uncertain by.
struct MapScale {
  double sd = 0.0;                                           ///< [-]
  Eigen::Vector2d p_map_centroid = Eigen::Vector2d::Zero();  ///< Of the modes. [m]
};

/// Takes what a map's scale is uncertain by out of its covariance: P' = P + sd² q qᵀ with the
/// largest sd that leaves a covariance P, sd² = 1 / qᵀP'⁻¹q, q the offsets from the centroid. So
/// the map is in its own units, of which what is observed on it tells nothing (mapper/METHOD.md, 3
/// and 9). Of a large map each tile by itself, the same sd for all.
///
/// A map that knows its scale better than its sensors do, as a survey does, stays as it is: sd 0.
///
/// @param sd_sensors  Of the scale that sensors get wrong together. [-]
MapScale RemoveScale(double sd_sensors, MapContent* content);

}  // namespace shiftmap

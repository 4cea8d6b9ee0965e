// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <vector>

#include "mapper/mapper_options.h"
#include "mapstore/core/ids.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// The error of a map without what runs cannot tell: where the map lies, how it is turned and, to a
/// few per cent, its scale.
struct MapShapeError {
  int landmarks = 0;
  double rms_m = 0.0;  ///< Of the positions.
  double nees = 0.0;   ///< In the covariance of the map.
  double dof = 0.0;    ///< What `nees` is expected to be.
};

/// Compares landmarks that have one mode with where they stood.
/// @param places  Of the landmarks during the runs of the map. [m]
/// @return Nothing for fewer than three.
std::optional<MapShapeError> MeasureMapShape(const MapContent& content,
                                             const std::map<Signature, Eigen::Vector2d>& places);

}  // namespace shiftmap

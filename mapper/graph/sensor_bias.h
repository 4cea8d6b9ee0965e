// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "localizer/models/observation_model.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// Systematic errors of a range-bearing sensor that its own runs tell: (bearing offset [rad], range
/// curvature κ [1/rad²]). At true range r and bearing b it reads
///
///   r (1 + κ (b² - b̄²)),   b + bearing offset.
///
/// Cameras that infer range from apparent size read the depth r cos b, κ ≈ -1/2. b̄² is the mean
/// over the run weighted by r², so that κ does not change the scale of the map.
///
/// Range scale and range offset are not among them, though the graph would fit them: it minimizes
/// over the poses instead of integrating over them, and a smaller world has smaller motion
/// residuals, so that it buys shrinkage with any parameter that sells it (README: scale). They stay
/// in the map's uncertainty. Cartesian observations have no such errors.
using SensorBias = Eigen::Vector2d;

/// Linearize() of the observation model with the sensor's systematic errors in h.
/// @param mean_squared_bearing  b̄². [rad²]
/// @param J_bias                If not null: dh / d bias.
Innovation LinearizeBiased(const Observation& observation,
                           const Se2& T_map_vehicle,
                           const Eigen::Vector2d& p_map_landmark,
                           const SensorBias& bias,
                           double mean_squared_bearing,
                           Eigen::Matrix2d* J_bias = nullptr);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "localizer/models/observation_model.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// Systematic errors of a run's sensor: (log range scale s, bearing offset β [rad], range curvature
/// κ [1/rad²]). At true range r and bearing b it reads
///
///   e^s r (1 + κ (b² - b̄²)),   b + β.
///
/// Cameras that infer range from apparent size read the depth r cos b, κ ≈ -1/2. b̄² is the mean
/// over the run weighted by r², so that κ does not change the scale of the map. Cartesian
/// observations have the scale alone, e^s q.
///
/// What the scale is, a run by itself cannot tell; two runs tell theirs apart, and a prior map
/// tells it in the map's own units (mapper/METHOD.md, 3).
using SensorBias = Eigen::Vector3d;
enum SensorBiasIndex { kLogRangeScale, kBearingOffset, kRangeCurvature };

/// Linearize() of the observation model with the sensor's systematic errors in h.
/// @param mean_squared_bearing  b̄². [rad²]
/// @param J_bias                If not null: dh / d bias.
Innovation LinearizeBiased(const Observation& observation,
                           const Se2& T_map_vehicle,
                           const Eigen::Vector2d& p_map_landmark,
                           const SensorBias& bias,
                           double mean_squared_bearing,
                           Eigen::Matrix<double, 2, 3>* J_bias = nullptr);

/// The observation as a sensor without systematic errors would have made it.
Observation Unbiased(const Observation& observation,
                     const SensorBias& bias,
                     double mean_squared_bearing);

/// A sensor's calibration with the bearing offset and the range curvature of a run.
SensorCalibration WithBias(SensorCalibration sensor,
                           const SensorBias& bias,
                           double mean_squared_bearing);

}  // namespace shiftmap

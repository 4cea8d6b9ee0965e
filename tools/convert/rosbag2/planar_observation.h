// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>

#include "mapstore/run/run.h"
#include "tools/convert/rosbag2/detections.h"
#include "tools/convert/rosbag2/rosbag2.h"

namespace shiftmap::rosbag2 {

/// What a detection in space says in the plane of the vehicle: Σ_xy = [R Σ Rᵀ]_xy with the rotation
/// R of the sensor in the vehicle, or of the model that the options name. Where there is no
/// covariance, or it is not positive definite, the observation is range and bearing and states
/// none.
/// Precondition: the position is finite.
Observation ToPlanar(const Detection& detection,
                     const Eigen::Isometry3d& T_vehicle_sensor,
                     const Rosbag2Options& options);

}  // namespace shiftmap::rosbag2

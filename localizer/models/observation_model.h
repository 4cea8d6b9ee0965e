// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapstore/geometry/se2.h"
#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// An observation against where it is expected: z ≈ h(T_map_vehicle, p_map_landmark) with
/// h = (|q|, atan2(q.y, q.x)) or q, T-IV (29), for q = R_map_vehicleᵀ (p_map_landmark -
/// t_map_vehicle).
struct Innovation {
  Eigen::Vector2d nu = Eigen::Vector2d::Zero();  ///< z - h, bearing wrapped. [m, rad] or [m, m]

  /// dh/dξ for T_map_vehicle·Exp(ξ), columns (x, y, yaw).
  Eigen::Matrix<double, 2, 3> H_pose = Eigen::Matrix<double, 2, 3>::Zero();

  Eigen::Matrix2d H_landmark = Eigen::Matrix2d::Zero();  ///< dh/dp_map_landmark.
};

/// Linearizes an observation. A landmark closer than a millimetre to the vehicle counts as that far
/// away: its bearing is undefined.
Innovation Linearize(const Observation& observation,
                     const Se2& T_map_vehicle,
                     const Eigen::Vector2d& p_map_landmark);

/// The observation without the systematic errors that the sensor's calibration knows of; Cartesian
/// ones are as they were.
Observation Corrected(const Observation& observation, const SensorCalibration& sensor);

/// Covariance of z: the observation's own, or the sensor's.
Eigen::Matrix2d ObservationNoise(const Observation& observation, const SensorCalibration& sensor);

/// Where the landmark stands if the vehicle is at T_map_vehicle. [m]
inline Eigen::Vector2d LandmarkPosition(const Observation& observation, const Se2& T_map_vehicle) {
  return T_map_vehicle * observation.PositionInVehicle();
}

/// Covariance, due to `cov_z` alone, of the landmark position in the vehicle frame. [m²]
Eigen::Matrix2d PositionNoiseInVehicle(const Observation& observation,
                                       const Eigen::Matrix2d& cov_z);

/// Converts a density per m² of the vehicle frame into one per unit of the observation's space:
/// dx dy = r dr db, so it is the range for range and bearing, 1 for Cartesian observations.
double SquareMetresPerUnit(const Observation& observation);

}  // namespace shiftmap

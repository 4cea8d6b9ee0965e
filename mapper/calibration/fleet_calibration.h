// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/estimate.h"

namespace shiftmap {

/// The sensor as a localizer on a vehicle that no run has calibrated must take it: the systematic
/// errors that the fleet has in common, and as noise what is each vehicle's own.
/// @param sd_range_scale  Standard deviation of the scale of ranges between sensors. [-]
SensorCalibration FleetSensor(const BuildState& build, double sd_range_scale);

/// The mean odometry of a fleet, with the spread between its vehicles.
OdometryCalibration FleetOdometry(const std::vector<BuildRun>& runs,
                                  const OdometryCalibration& fallback);

/// The noise of one vehicle.
struct VehicleNoise {
  NoiseEstimate v;      ///< [m/√s]
  NoiseEstimate omega;  ///< [rad/√s]
  NoiseEstimate range_m;
  NoiseEstimate bearing_rad;
  NoiseEstimate position_m;  ///< Of Cartesian observations.
};

/// The noise of some runs of one vehicle over what a localizer sees of it: of the odometry over
/// spans of seconds, in which its errors are correlated, and of observations whose runs have the
/// vehicle's systematic errors rather than each its own. Residuals do not show what the poses of a
/// run take up; ranges have the fleet's spread on top.
/// @param runs                  Indices.
/// @param mean_squared_bearing  b̄² of the vehicle. [rad²]
VehicleNoise NoiseOverSeconds(const BuildState& build,
                              const std::vector<RunIndex>& runs,
                              const SensorBias& bias,
                              double mean_squared_bearing,
                              double sd_range_scale);

/// The larger of two estimates of one noise.
NoiseEstimate Larger(const NoiseEstimate& a, const NoiseEstimate& b);

}  // namespace shiftmap

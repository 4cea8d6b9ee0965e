// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/map_problem.h"
#include "mapper/mapper_options.h"
#include "mapstore/map/calibration.h"

namespace shiftmap {

/// Field of view, detection rate and clutter density of the fleet's sensor, from where its
/// landmarks stood while it drove. P_D0 is the share of (scan, landmark in the field of view) pairs
/// with a detection.
SensorCalibration EstimateDetection(const MapProblem& problem, const ModeOptions& options);

/// The sensor as a localizer on a vehicle that no run has calibrated must take it: the systematic
/// errors that the fleet has in common, and as noise what is each vehicle's own.
/// @param sd_range_scale  Standard deviation of the scale of ranges between sensors. [-]
SensorCalibration FleetSensor(const MapProblem& problem, double sd_range_scale);

/// The mean odometry of a fleet, with the spread between its vehicles.
OdometryCalibration FleetOdometry(const std::vector<BuildRun>& runs,
                                  const OdometryCalibration& fallback);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/map_problem.h"
#include "mapper/mapper.h"
#include "mapper/mapper_options.h"

namespace shiftmap {

/// Field of view, detection rate and clutter density of the fleet's sensor, from where its
/// landmarks stood while it drove. P_D0 is the share of (scan, landmark in the field of view) pairs
/// with a detection.
SensorCalibration EstimateDetection(const MapProblem& problem, const ModeOptions& options);

/// The map that a solved problem is: numbered modes, joint covariance, chains, probabilities at the
/// end of the newest run.
MapContent MakeMapContent(const MapProblem& problem,
                          const std::optional<MapContent>& prior,
                          const Eigen::MatrixXd& mode_covariance,
                          const MapperOptions& options);

/// What became of run `index` of a solved problem.
MappedRun MakeMappedRun(const MapProblem& problem, std::size_t index);

/// The mean odometry of a fleet, with the spread between its vehicles.
OdometryCalibration FleetOdometry(const std::vector<BuildRun>& runs,
                                  const OdometryCalibration& fallback);

}  // namespace shiftmap

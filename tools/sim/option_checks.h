// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/map/calibration.h"
#include "proto/core/status.h"

namespace shiftmap {

// Each returns kInvalidArgument, `world: <name> = <value>, expected ...`, unless it holds.
Status CheckProbability(const char* name, double value);
Status CheckPositive(const char* name, double value);
Status CheckNotNegative(const char* name, double value);

/// How the true motion follows from the log: scales, lag, noise.
Status CheckOdometry(const OdometryCalibration& odometry);

/// Noise, field of view and detection of a sensor that reads signatures.
Status CheckLandmarkSensor(const SensorCalibration& sensor);

}  // namespace shiftmap

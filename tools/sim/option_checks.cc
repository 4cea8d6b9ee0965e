// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/option_checks.h"

#include <cmath>

namespace shiftmap {
namespace {

Status Check(bool ok, const char* name, double got, const char* expected) {
  return ok ? OkStatus() : InvalidArgument("world: {} = {}, expected {}", name, got, expected);
}

}  // namespace

Status CheckProbability(const char* name, double value) {
  return Check(value >= 0.0 && value <= 1.0, name, value, "0..1");
}

Status CheckPositive(const char* name, double value) {
  return Check(std::isfinite(value) && value > 0.0, name, value, "> 0");
}

Status CheckNotNegative(const char* name, double value) {
  return Check(std::isfinite(value) && value >= 0.0, name, value, ">= 0");
}

Status CheckOdometry(const OdometryCalibration& odometry) {
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("odometry scale of v", odometry.scale_v));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("odometry scale of omega", odometry.scale_omega));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("odometry lag", odometry.lag_s));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("odometry noise of v", odometry.noise_v));
  return CheckNotNegative("odometry noise of omega", odometry.noise_omega);
}

Status CheckLandmarkSensor(const SensorCalibration& sensor) {
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("range noise", sensor.sd_range_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotNegative("bearing noise", sensor.sd_bearing_rad));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("maximum range", sensor.max_range_m));
  SHIFTMAP_RETURN_IF_ERROR(CheckPositive("maximum bearing", sensor.max_bearing_rad));
  return CheckProbability("detection probability", sensor.detection_probability);
}

}  // namespace shiftmap

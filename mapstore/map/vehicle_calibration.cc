// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/vehicle_calibration.h"

#include <algorithm>
#include <cmath>

#include "mapstore/core/magnitude.h"
#include "mapstore/map/run_spread.h"

namespace shiftmap {
namespace {

bool IsValid(const Estimate& estimate) {
  return std::abs(estimate.value) <= kMaxMagnitude && estimate.sd > 0.0 &&
         estimate.sd <= kMaxMagnitude;
}

bool IsValid(const NoiseEstimate& noise) {
  if (!std::isfinite(noise.sd) || !std::isfinite(noise.dof) || noise.dof < 0.0) return false;
  return noise.sd <= kMaxMagnitude && noise.sd >= (noise.known() ? kMinMagnitude : 0.0);
}

bool IsValid(const ShareEstimate& share) {
  return share.share >= 0.0 && share.share <= 1.0 && share.trials >= 0.0 &&
         std::isfinite(share.trials);
}

void SetIfKnown(const NoiseEstimate& noise, double* sd) {
  if (noise.known()) *sd = noise.sd;
}

}  // namespace

const std::array<const char*, kVehicleValues> kVehicleValueNames = {"log_scale_v",
                                                                    "log_scale_v_sd",
                                                                    "log_scale_omega",
                                                                    "log_scale_omega_sd",
                                                                    "lag_s",
                                                                    "lag_sd_s",
                                                                    "bearing_offset_rad",
                                                                    "bearing_offset_sd_rad",
                                                                    "range_curvature_per_rad2",
                                                                    "range_curvature_sd_per_rad2",
                                                                    "mean_squared_bearing_rad2",
                                                                    "noise_v_m_per_sqrt_s",
                                                                    "noise_v_dof",
                                                                    "noise_omega_rad_per_sqrt_s",
                                                                    "noise_omega_dof",
                                                                    "sd_range_m",
                                                                    "sd_range_dof",
                                                                    "sd_bearing_rad",
                                                                    "sd_bearing_dof",
                                                                    "sd_position_m",
                                                                    "sd_position_dof",
                                                                    "detection_probability",
                                                                    "detection_trials"};

std::array<double*, kVehicleValues> VehicleValues(VehicleCalibration* vehicle) {
  return {&vehicle->log_scale_v.value,
          &vehicle->log_scale_v.sd,
          &vehicle->log_scale_omega.value,
          &vehicle->log_scale_omega.sd,
          &vehicle->lag_s.value,
          &vehicle->lag_s.sd,
          &vehicle->bearing_offset_rad.value,
          &vehicle->bearing_offset_rad.sd,
          &vehicle->range_curvature_per_rad2.value,
          &vehicle->range_curvature_per_rad2.sd,
          &vehicle->mean_squared_bearing_rad2,
          &vehicle->noise_v.sd,
          &vehicle->noise_v.dof,
          &vehicle->noise_omega.sd,
          &vehicle->noise_omega.dof,
          &vehicle->range_m.sd,
          &vehicle->range_m.dof,
          &vehicle->bearing_rad.sd,
          &vehicle->bearing_rad.dof,
          &vehicle->position_m.sd,
          &vehicle->position_m.dof,
          &vehicle->detection.share,
          &vehicle->detection.trials};
}

std::array<double, kVehicleValues> VehicleValues(const VehicleCalibration& vehicle) {
  VehicleCalibration copy = vehicle;
  std::array<double, kVehicleValues> values{};
  std::size_t i = 0;
  for (const double* value : VehicleValues(&copy)) values[i++] = *value;
  return values;
}

Status ValidateVehicleCalibration(const VehicleCalibration& vehicle) {
  if (vehicle.vehicle.empty()) return InvalidArgument("a vehicle has an empty name");
  const bool valid =
      vehicle.runs >= 1 && IsValid(vehicle.log_scale_v) && IsValid(vehicle.log_scale_omega) &&
      std::abs(vehicle.log_scale_v.value) < 10.0 &&
      std::abs(vehicle.log_scale_omega.value) < 10.0 && IsValid(vehicle.lag_s) &&
      std::abs(vehicle.lag_s.value) <= kMaxLagS && IsValid(vehicle.bearing_offset_rad) &&
      IsValid(vehicle.range_curvature_per_rad2) &&
      vehicle.mean_squared_bearing_rad2 <= kMaxMagnitude &&
      vehicle.mean_squared_bearing_rad2 >= 0.0 && IsValid(vehicle.noise_v) &&
      IsValid(vehicle.noise_omega) && IsValid(vehicle.range_m) && IsValid(vehicle.bearing_rad) &&
      IsValid(vehicle.position_m) && IsValid(vehicle.detection);
  if (valid) return OkStatus();
  return InvalidArgument("vehicle '{}': calibration out of range", vehicle.vehicle);
}

Calibration CalibrationOf(const VehicleCalibration& vehicle, const Calibration& fleet) {
  Calibration own = fleet;
  own.odometry.scale_v = std::exp(vehicle.log_scale_v.value);
  own.odometry.scale_omega = std::exp(vehicle.log_scale_omega.value);
  own.odometry.lag_s = vehicle.lag_s.value;
  own.odometry.sd_log_scale = std::hypot(
      std::max(vehicle.log_scale_v.sd, vehicle.log_scale_omega.sd), kRunSpread.log_scale);
  SetIfKnown(vehicle.noise_v, &own.odometry.noise_v);
  SetIfKnown(vehicle.noise_omega, &own.odometry.noise_omega);

  SensorCalibration& sensor = own.sensor;
  SetIfKnown(vehicle.range_m, &sensor.sd_range_m);
  SetIfKnown(vehicle.position_m, &sensor.sd_position_m);
  if (vehicle.bearing_rad.known()) {
    sensor.sd_bearing_rad = std::hypot(
        vehicle.bearing_rad.sd, vehicle.bearing_offset_rad.sd, kRunSpread.bearing_offset_rad);
    sensor.bearing_offset_rad = vehicle.bearing_offset_rad.value;
    sensor.range_curvature_per_rad2 = vehicle.range_curvature_per_rad2.value;
    sensor.mean_squared_bearing_rad2 = vehicle.mean_squared_bearing_rad2;
  }
  if (vehicle.detection.trials > 0.0) {
    sensor.detection_probability =
        std::clamp(vehicle.detection.share, kMinDetection, kMaxDetection);
  }
  return own;
}

}  // namespace shiftmap

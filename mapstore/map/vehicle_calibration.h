// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "mapstore/core/stamp.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/estimate.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What a map version knows of one vehicle of the fleet, from all runs that the version and its
/// ancestors were built from. Terms as in Calibration.
struct VehicleCalibration {
  std::string vehicle;    ///< As its logs name it; not empty.
  std::int64_t runs = 0;  ///< That tell of it, 1 or more.
  Stamp stamp;            ///< End of the newest of them.

  // Systematic errors.
  Estimate log_scale_v;      ///< Logarithm of the scale. [-]
  Estimate log_scale_omega;  ///< [-]
  Estimate lag_s;
  Estimate bearing_offset_rad;
  Estimate range_curvature_per_rad2;
  double mean_squared_bearing_rad2 = 0.0;  ///< b̄², where its ranges are right.

  // Noise as a localizer takes it: what is left once the systematic errors are taken off, over
  // seconds rather than from scan to scan.
  NoiseEstimate noise_v;      ///< [m/√s]
  NoiseEstimate noise_omega;  ///< [rad/√s]
  NoiseEstimate range_m;
  NoiseEstimate bearing_rad;
  NoiseEstimate position_m;  ///< Of Cartesian observations.

  ShareEstimate detection;  ///< P_D0.
};

/// Number of values of a vehicle's calibration.
inline constexpr std::size_t kVehicleValues = 23;

/// All of them, in the order in which files and the content hash have them.
std::array<double*, kVehicleValues> VehicleValues(VehicleCalibration* vehicle);
std::array<double, kVehicleValues> VehicleValues(const VehicleCalibration& vehicle);

/// Their names, with units: the columns of the store.
extern const std::array<const char*, kVehicleValues> kVehicleValueNames;

/// Errors: kInvalidArgument, naming the vehicle, if a value is out of range.
Status ValidateVehicleCalibration(const VehicleCalibration& vehicle);

/// What a localizer on the vehicle uses: the fleet's calibration with what is known of the vehicle
/// in its place. What is still uncertain of this run's bearing offset is part of the bearings'
/// noise, that of its scales is `sd_log_scale`.
Calibration CalibrationOf(const VehicleCalibration& vehicle, const Calibration& fleet);

}  // namespace shiftmap

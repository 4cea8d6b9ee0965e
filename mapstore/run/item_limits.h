// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What a vehicle and its sensor can physically do. A value beyond it is an error of the device, as
/// where a driver writes its largest number for "no reading"; it carries no information and is
/// dropped. ValidateEvent() is wider: it rejects what no log may hold.
struct ItemLimits {
  /// Of a landmark from the vehicle, and of the standard deviations that a log states for it, > 0.
  /// [m]
  double max_range_m = 1000.0;

  /// Of the vehicle, forwards or backwards, > 0. [m/s]
  double max_speed_mps = 100.0;

  /// Of the vehicle, > 0. [rad/s]
  double max_yaw_rate_radps = 50.0;

  /// The defaults, with a longer range where the sensor sees as far: ten times its field of view.
  static ItemLimits For(const SensorCalibration& sensor);
};

/// Limits, where somebody knows better than ItemLimits::For().
struct LimitOptions {
  std::optional<double> max_range_m;         ///< In (0, 1e9]. [m]
  std::optional<double> max_speed_mps;       ///< In (0, 1e9]. [m/s]
  std::optional<double> max_yaw_rate_radps;  ///< In (0, 1e9]. [rad/s]

  ItemLimits For(const SensorCalibration& sensor) const;

  /// Errors: kInvalidArgument, naming the first out of range.
  Status Validate() const;
};

/// Items that were dropped because they are beyond the limits.
struct ImplausibleItems {
  std::int64_t odometry = 0;
  std::int64_t observations = 0;

  bool any() const { return odometry > 0 || observations > 0; }
};

bool IsPlausible(const OdometrySample& sample, const ItemLimits& limits);

/// Also false if the observation states a covariance that no sensor has: a bearing that says
/// nothing (standard deviation above π), a position that says nothing (above the range), or one
/// that says more than anybody can know (below 1e-6 m or rad).
bool IsPlausible(const Observation& observation, const ItemLimits& limits);

/// Drops what is implausible from a run. A scan stays, also if it then says that it saw nothing.
ImplausibleItems DropImplausible(const ItemLimits& limits, Run* run);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "mapstore/core/day.h"
#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/calibration.h"
#include "proto/core/status.h"
#include "tools/sim/simulated_world.h"

namespace shiftmap {

/// An open square floor with landmarks that stand at one of several places each, and a vehicle that
/// drives there shift after shift.
struct OpenWorldOptions {
  std::uint64_t seed = 1;

  int groups = 20;          ///< Landmarks. > 0.
  int modes_per_group = 2;  ///< Places that a landmark can stand at. > 0.
  double size_m = 40.0;     ///< Edge of the floor, which spans [0, size]². [m]
  double mode_gap_m = 2.0;  ///< Least distance between any two places. [m]

  int runs = 3;
  int vehicles = 2;                          ///< That take turns, a run each. > 0.
  double duration_s = 300.0;                 ///< Of each run. [s]
  double shift_interval_s = kSecondsPerDay;  ///< From the start of one run to that of the next. [s]
  Stamp start = StampFromSeconds(1767600000.0);

  /// Between two runs each landmark moves to another of its places with this probability.
  double mode_change_probability = 0.25;

  /// In each run each landmark is away altogether with this probability.
  double absent_probability = 0.0;

  /// Where each landmark stands, by run and group, instead of what is drawn as above; empty: drawn.
  std::vector<std::vector<ModeNumber>> states = {};

  double odometry_rate_hz = 20.0;
  double scan_rate_hz = 5.0;  ///< At most the odometry's; scans coincide with odometry.
  double speed_mps = 1.5;     ///< Top speed. [m/s]

  /// How the true motion follows from the logged odometry, in the terms of AppendMotion().
  OdometryCalibration odometry{.noise_v = 0.01, .noise_omega = 0.01};

  /// Noise, field of view and detection rate of the sensor. Its densities are not used.
  SensorCalibration sensor{.sd_range_m = 0.1, .sd_bearing_rad = 0.02, .detection_probability = 0.8};

  /// Expected number of false observations per scan, uniform over the field of view, with the
  /// signature of some landmark.
  double clutter_per_scan = 0.0;

  /// Asked before each run; true ends the simulation with kCancelled. May be null.
  std::function<bool()> stopped = {};

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// Simulates a world. The true motion of each odometry interval is the exact arc of the logged
/// velocity, scaled, lagged, and disturbed by a random walk in the vehicle frame. Scans without
/// any observation are logged: the sensor looked and saw nothing.
/// Determinism: the same options give the same bits.
/// Errors: as Validate(); kInvalidArgument if the places do not fit on the floor; kCancelled.
StatusOr<SimulatedWorld> SimulateOpen(const OpenWorldOptions& options);

}  // namespace shiftmap

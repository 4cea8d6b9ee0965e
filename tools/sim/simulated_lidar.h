// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "mapstore/run/lidar_scan.h"
#include "proto/core/status.h"
#include "tools/sim/random.h"
#include "tools/sim/ray_caster.h"

namespace shiftmap {

/// Errors of a range r that hits a wall at angle φ to its normal. They stand in for the support
/// vector machine that T-IV IX-B takes, which has the same inputs; its parameters are not
/// published there:
///
///   sd(r, φ) = (base_sd + sd_per_m · r) / max(cos φ, min_cos)
///   P(no return) = 1 - cos φ / grazing_cos   for cos φ < grazing_cos, else 0.
struct RangeNoise {
  double base_sd_m = 0.01;    ///< At the lidar, straight onto the wall. >= 0. [m]
  double sd_per_m = 0.001;    ///< >= 0. [-]
  double min_cos = 0.1;       ///< Bounds the effect of the angle, in (0, 1]. [-]
  double grazing_cos = 0.05;  ///< Rays flatter than this get lost, in [0, 1]. [-]

  double Sd(double range_m, double cos_incidence) const;
  double DropoutProbability(double cos_incidence) const;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// A lidar on a vehicle, and what it gets wrong.
struct SimulatedLidar {
  LidarSensor sensor;
  int beams = 361;  ///< >= 2.
  RangeNoise noise;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// One scan of walls. A beam that hits nothing within the lidar's range, or is lost, reads the
/// maximum range, which is no return.
/// @param ranges_m  Of size lidar.beams; receives one range per beam, by LidarSensor::Bearing. [m]
void TakeRanges(const RayCaster& walls,
                const SimulatedLidar& lidar,
                const Se2& T_map_vehicle,
                Random* random,
                std::span<double> ranges_m);

}  // namespace shiftmap

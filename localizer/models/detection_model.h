// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapstore/map/calibration.h"

namespace shiftmap {

/// A field of view: ranges r < γ_r, and bearings b with |b - centre| < γ_b.
struct Sector {
  double max_range_m = 0.0;
  double centre_rad = 0.0;
  double half_width_rad = 0.0;  ///< From 2π on: all round.

  bool Contains(const Eigen::Vector2d& q) const;  ///< @param q  Vehicle frame. [m]
};

/// Of a map's sensor, ahead.
inline Sector SectorOf(const SensorCalibration& sensor) {
  return {sensor.max_range_m, 0.0, sensor.max_bearing_rad};
}

/// P_FOV of a landmark under the sector model, IJRR 7.2: P(r < γ_r) · P(|b| < γ_b) for independent
/// Gaussian r and b.
/// @param range_bearing  Expected (range, bearing). [m, rad]
/// @param cov            Under the joint uncertainty of pose and landmark. [m², m rad, rad²]
double SectorFieldOfView(const Eigen::Vector2d& range_bearing,
                         const Eigen::Matrix2d& cov,
                         const Sector& sector);

/// True if a point is in the field of view whatever the uncertainty of the pose: clear of its
/// limits, and not too near.
/// @param q  Vehicle frame. [m]
bool WellInView(const Eigen::Vector2d& q, const Sector& sector);

/// The log-likelihood of missing a landmark in every scan of a run of scans, when with probability
/// ε it is occluded for the whole run: log((1 - ε) Π(1 - P_D) + ε) >= log ε.
///
/// Occlusions last (a parked truck, another robot), so misses are not independent and silence
/// alone must not decide; without ε a hundred scans past an occluded landmark would prove it gone.
/// @param log_missed  Σ log(1 - P_D) over the run, <= 0.
/// @param occluded    ε in (0, 1).
double LogMissedRun(double log_missed, double occluded);

}  // namespace shiftmap

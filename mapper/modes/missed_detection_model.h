// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "mapstore/map/calibration.h"
#include "mapstore/map/visibility.h"

namespace shiftmap {

/// The entry of DirectionCounts for a view of a landmark.
/// @param view  From the landmark to the vehicle, map frame. [m]
std::size_t DirectionOf(const Eigen::Vector2d& view);

struct MissedDetectionOptions {
  /// Share of landmarks that only half of all directions can see, such as a sign on a wall. Raising
  /// it makes missed detections from few directions weigh less. In [0, 1).
  double one_sided_probability = 0.3;

  /// Detection probabilities of landmarks differ: Beta distribution with the sensor's P_D0 as its
  /// mean and this many trials. Lowering it makes many misses weigh less. > 0. [-]
  double detection_concentration = 4.0;
};

/// Log-likelihood of not detecting a landmark in any scan of some passes, given that it stands at a
/// mode well in view, against log 1 if it does not: negative information as IJRR (28), with what
/// misses have in common integrated out. [nat]
///
/// A landmark has a detection probability P ~ Beta and a set V of directions that can see it: all
/// of them, or one of the eight half circles. With the n_p(V) scans of a pass p in V,
///
///   L = E[ Π_p (ε + (1 - ε) (1 - P)^n_p(V)) ],
///
/// over the posterior of (P, V) given the scans in which it stood there; ε is the probability that
/// it is occluded for a whole pass. So one pass proves no more than log ε, and misses from one side
/// no more than log of the share of one-sided landmarks.
///
/// @param passes  Scans without a detection, per pass by direction.
/// @param known   Scans from which the visibility of the landmark is known.
/// @param sensor  P_D0, the mean of P, and ε (occluded_visit_probability).
double LogMissedPasses(const std::vector<DirectionCounts>& passes,
                       const Visibility& known,
                       const SensorCalibration& sensor,
                       const MissedDetectionOptions& options);

}  // namespace shiftmap

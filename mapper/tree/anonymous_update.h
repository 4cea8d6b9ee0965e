// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "mapper/association/slam_association.h"
#include "mapper/frontend/slam_state.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"

namespace shiftmap {

struct AnonymousOptions {
  /// Which observation is of which landmark. T-IV IX-E: kNearest.
  AssociationMethod association = AssociationMethod::kNearest;

  /// As TreeSlamOptions::gate_probability.
  double gate_probability = 0.99;

  /// An observation of no landmark begins one if it is outside of this gate of all others: else it
  /// is a badly measured one.
  double isolation_probability = 0.9999;

  /// A landmark is dropped if it was not seen so often within so many scans of its first.
  int confirm_sightings = 3;
  int confirm_within_scans = 15;
};

/// A landmark without signature.
struct AnonymousLandmark {
  int landmark = 0;  ///< In the state.
  int sightings = 0;
  int first_scan = 0;
  Stamp last_seen = {};
};

/// Corrects a state by observations without signature, and begins landmarks with those that are of
/// none: first those confirmed are associated, then the others.
/// @param observations  Indices in `scan`.
/// @param scan_number   Counts scans, for `confirm_within_scans`.
/// @return The log-likelihood of the observations: P_D N(ν; 0, S) of those associated, β_FA + β_NT
///         of the others.
double UpdateAnonymous(const Scan& scan,
                       std::span<const int> observations,
                       int scan_number,
                       const SensorCalibration& sensor,
                       const AnonymousOptions& options,
                       std::vector<AnonymousLandmark>* known,
                       SlamState* state);

}  // namespace shiftmap

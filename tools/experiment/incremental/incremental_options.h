// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>

#include "mapper/selection/selector.h"
#include "mapstore/map/calibration.h"
#include "proto/core/status.h"
#include "tools/experiment/incremental/fixed_lag_smoother.h"

namespace shiftmap {

struct IncrementalOptions {
  SelectorOptions selector;

  /// Poses and choices older than this are no longer changed. Raising it makes steps costlier. At
  /// most 1e9, or infinite. [s]
  double window_s = std::numeric_limits<double>::infinity();

  /// An observation belongs to a mode if its innovation is within this quantile. Lowering it makes
  /// modes of smaller displacements, and of noise. In (0, 1).
  double gate_probability = 0.99;

  /// Observations beyond the gate of every mode that have to agree on a place within the same
  /// quantile, for a mode there. 1 is IJRR 7.1: each of them makes one.
  int min_sightings = 3;

  /// Two modes of a group are one unless their difference is beyond this quantile, with
  /// `position_floor_m` added to either position for what the models leave out. 0 never merges. In
  /// [0, 1). [m]
  double merge_probability = 0.99;
  double position_floor_m = 0.07;

  /// Of leaving a mode from one frame to the next in which the landmark is in view; IJRR 8.2.2. In
  /// (0, 1).
  double change_probability = 1e-4;

  /// Noise where an observation states none, field of view, and probability of detection.
  SensorCalibration sensor;

  /// b̄² of SensorBias; without effect while the calibration is held. [rad²]
  double mean_squared_bearing_rad2 = 0.0;

  SmootherOptions smoother;

  /// Of selecting and solving in a step, IJRR 8.2.2; a full optimization follows where they do not
  /// settle.
  int max_alternations = 10;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

}  // namespace shiftmap

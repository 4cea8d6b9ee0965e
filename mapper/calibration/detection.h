// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"
#include "mapper/problem/mode_grid.h"
#include "mapstore/map/calibration.h"

namespace shiftmap {

/// Of (key frame, landmark in the field of view) pairs.
struct DetectionCount {
  double expected = 0.0;
  double detected = 0.0;
};

/// Adds what stood in the field of view of `sensor` at a run's key frames. A landmark stands where
/// the visit going on has it, or the last one; before its first visit of the run it is not counted.
/// Key frames are where something is seen: a frame that only the landmark itself makes one is not
/// counted for it, or it would never be missed alone.
/// @param grid  Of the problem's modes, for the sensor's range at least.
void CountDetections(const MapProblem& problem,
                     const SensorCalibration& sensor,
                     const ModeGrid& grid,
                     const BuildRun& run,
                     DetectionCount* count);

/// The problem's sensor with field of view, P_D0 and clutter density of the fleet, from where its
/// landmarks stood while it drove; as it was if fewer than `options.min_sightings` tell of it.
SensorCalibration EstimateDetection(const MapProblem& problem, const ModeOptions& options);

}  // namespace shiftmap

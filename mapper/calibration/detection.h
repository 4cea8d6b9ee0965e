// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "localizer/models/detection_model.h"
#include "localizer/models/mode_grid.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "mapstore/map/calibration.h"

namespace shiftmap {

/// Of (key frame, landmark in the field of view) pairs.
struct DetectionCount {
  double expected = 0.0;
  double detected = 0.0;
};

/// A build's modes by where they are.
/// @param cell_m  As of ModeGrid: best about the range of the sensor. [m]
ModeGrid GridOf(const BuildState& build, double cell_m);

/// The sector in which a run itself saw landmarks where the map has them: what stands beyond was
/// not in its view, whatever other vehicles see.
Sector OwnSector(const BuildState& build, const SensorCalibration& sensor, const BuildRun& run);

/// Adds what stood in the run's own sector, OwnSector(), at its key frames. A landmark stands
/// where the visit going on has it, or the last one; before its first visit of the run it is not
/// counted. Key frames are where something is seen: a frame that only the landmark itself makes one
/// is not counted for it, or it would never be missed alone.
/// @param grid  Of the build's modes.
void CountDetections(const BuildState& build,
                     const SensorCalibration& sensor,
                     const ModeGrid& grid,
                     const BuildRun& run,
                     DetectionCount* count);

/// Sets the field of view to what holds nearly all of the observations.
/// @param positions  Of landmarks in the vehicle frame, one at least. [m]
void SetFieldOfView(const std::vector<Eigen::Vector2d>& positions, SensorCalibration* sensor);

/// Sets P_D0 from counts, with a Beta(1, 1) prior, and never so certain that one scan decides.
void SetDetection(const DetectionCount& count, SensorCalibration* sensor);

/// The build's sensor with field of view, P_D0 and clutter density of the fleet, from where its
/// landmarks stood while it drove; as it was if fewer than `options.min_sightings` tell of it.
SensorCalibration EstimateDetection(const BuildState& build, const ModeOptions& options);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/frontend/frame_motions.h"
#include "mapper/frontend/mapping_run.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/calibration.h"

namespace shiftmap {

/// Poses of a run's key frames in the frame of its first one, for a start of the graph: dead
/// reckoning drifts into wrong minima, a filter that closes loops does not.
///
/// EKF-SLAM over the pose, (log scale_v, log scale_omega) of the odometry and one position per
/// landmark (SlamState): what moved, or was misread, does not gate and is skipped. A frame costs
/// the square of the landmarks around the vehicle. At the end poses are smoothed: a filter that
/// closes a loop corrects its map, but does not go back to where it has been.
/// @param motions      Of the run.
/// @param calibration  Of odometry and sensor, systematic errors of the sensor included.
/// @return One pose per key frame, T_start_vehicle.
std::vector<Se2> EstimateTrajectoryByEkf(const MappingRun& run,
                                         const FrameMotions& motions,
                                         const Calibration& calibration);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

/// Stretches of a recorded run without sightings, and with a single landmark in view after each.
struct BlindStretches {
  double every_s = 120.0;  ///< From the begin of one to that of the next. [s]
  double blind_s = 0.0;    ///< Scans are dropped for as long; 0: none are. [s]
  double alone_s = 20.0;   ///< After it one landmark is seen: the first. [s]
};

/// The log as a vehicle would have recorded it that saw less.
Run WithBlindStretches(const Run& run, const BlindStretches& stretches);

/// What a localizer made of a recorded run on a map of the same layout.
struct RecordedResult {
  double start_s = 0.0;  ///< Up to the first pose. [s]
  double rmse_m = 0.0;   ///< Of the position, after alignment of the trajectory.
  double nees = 0.0;     ///< Mean, of poses against the truth; 3 if consistent.
  double nis = 0.0;      ///< Mean, 2 if consistent.
  double lost_s = 0.0;
  int decisions = 0;
  int wrong = 0;       ///< Of them: for a state that did not hold.
  int wrong_last = 0;  ///< Of those: without a right one within 20 s.
};

/// Localizes a run, started from its signatures alone.
/// @param truth   Poses of the vehicle.
/// @param places  Where the landmarks stood, in the frame of the truth. [m]
/// Errors: EvaluateTrajectory()'s; kInvalidArgument if the run is never localized.
StatusOr<RecordedResult> LocalizeRecorded(const MapSnapshot& map,
                                          const Run& run,
                                          const std::vector<StampedPose>& truth,
                                          const std::map<Signature, Eigen::Vector2d>& places);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "mapper/state/build_state.h"
#include "mapstore/core/stamp.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/run_record.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// What became of one run; its trajectory has all key frames.
struct MappedRun : RunRecord {
  int poses = 0;
  int observations = 0;            ///< Of identified landmarks, used or not.
  int outliers = 0;                ///< Of those, not explained by the mode of their visit.
  int duplicate_observations = 0;  ///< One signature at two places in one scan: left out.
  int near_observations = 0;       ///< Too near to tell a bearing: left out.
  int anonymous_observations = 0;  ///< Without a signature, also not associated: left out.
  double chi2 = 0.0;  ///< Sum of squared standardized residuals of the explained observations.
  double variance_factor = 1.0;  ///< Of its errors, by the assumed noise (run_variances.h).
  Se2 T_map_start;               ///< Pose at the first odometry sample.
  OdometryCalibration odometry;
  SensorBias sensor_bias = SensorBias::Zero();

  /// After which key frames the vehicle was moved and its odometry did not see it.
  std::vector<Stamp> moved;
};

/// T_map_vehicle at the first sample of odometry: back along it from the pose at a scan.
Se2 PoseAtBegin(std::span<const OdometrySample> odometry,
                const OdometryCalibration& calibration,
                Stamp scan,
                const Se2& T_map_vehicle);

/// T_map_vehicle of a run at its first odometry sample: from its first key frame, back along the
/// odometry.
Se2 StartPose(const BuildRun& run);

/// Puts the start of the earliest run at the origin of the map.
void AnchorFrame(BuildState* build);

/// What became of run `index` of a solved build, but for its evidence and visibility.
MappedRun MakeMappedRun(const BuildState& build, RunIndex index);

}  // namespace shiftmap

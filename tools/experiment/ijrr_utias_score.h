// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/mapper.h"
#include "tools/experiment/ijrr_utias_data.h"

namespace shiftmap {

/// What a method makes of a case: one comparable form for all of them.
struct UtiasEstimate {
  std::vector<Se2> poses;       ///< T_map_vehicle at every key frame.
  std::vector<Se2> step_poses;  ///< The same when the frame came in; empty for a batch.
  IndexedVector<GroupIndex, std::vector<Eigen::Vector2d>> modes;  ///< [m]

  /// Per sighting of the case: the mode of its landmark that it is of, or -1 for none.
  IndexedVector<SightingIndex, int> sighting_modes;

  int created = 0;             ///< Modes that the map did not have.
  int full_optimizations = 0;  ///< Steps whose alternation did not settle.

  /// What the build does not decide. If it waits there are no poses.
  std::vector<AmbiguousChange> ambiguous_changes;
};

/// Errors against the truth, without alignment: the map holds the frame.
struct UtiasScore {
  double pose_rmse_m = 0.0;       ///< Of the position, over key frames with a true pose.
  double step_pose_rmse_m = 0.0;  ///< The same of the poses when they came in; 0 for a batch.
  double landmark_rmse_m = 0.0;   ///< Over landmarks that are seen.
  int poses = 0;
  int landmarks = 0;
  int modes = 0;  ///< Of all landmarks.
};

/// Scores an estimate. The squared error of a landmark is the mean over its modes, weighted by the
/// visits that they explain: a visit counts one, shared among modes as its sightings are. So a
/// misread signature does not decide over a landmark, and a mode that explains nothing does not
/// count. A landmark of which no sighting is explained stands where its first mode is.
/// Precondition: there are poses.
UtiasScore ScoreUtias(const UtiasCase& data, const UtiasEstimate& estimate);

/// The probability that an estimate gives to what is true, of what it does not decide: that of the
/// landmarks that are seen those of UtiasCase::moved were displaced and no others. Nothing if it
/// decides.
std::optional<double> ProbabilityOfTruth(const UtiasCase& data, const UtiasEstimate& estimate);

/// The result of the mapper in that form. Which mode a visit is of follows from its sightings: the
/// most likely, or none if clutter explains them better.
/// Precondition: the one run of the case was mapped, or waits.
UtiasEstimate FromMapperResult(const UtiasCase& data, const MapperResult& result);

}  // namespace shiftmap

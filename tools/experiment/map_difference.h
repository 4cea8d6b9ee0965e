// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapstore/map/landmark_group.h"
#include "proto/core/status.h"

namespace shiftmap {

/// How far a map is from another one of the same landmarks, after one rigid alignment.
struct MapDifference {
  int modes = 0;                ///< Of the reference.
  int missing_modes = 0;        ///< Of these: the map has none of the landmark within 0.3 m.
  int added_modes = 0;          ///< Of the map: the reference has none.
  double position_max_m = 0.0;  ///< Of the modes that both have,
  double position_rms_m = 0.0;

  int groups = 0;          ///< Of the reference.
  int sure = 0;            ///< The reference has a state at odds of more than 20 to 1,
  int other_state = 0;     ///< and the likeliest state of the map is another one.
  double variation = 0.0;  ///< Total variation between the probabilities, mean over the groups.
  double variation_max = 0.0;

  /// Of the map's leave rate over the reference's, of groups that both have and that move.
  std::vector<double> log_rate_ratios;
};

/// @param reference, map  By ascending signature, with probabilities at one time.
/// Errors: kInvalidArgument if no rigid transform brings two of the modes together.
StatusOr<MapDifference> CompareMaps(const std::vector<LandmarkGroup>& reference,
                                    const std::vector<LandmarkGroup>& map);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <utility>
#include <vector>

#include "mapstore/map/map_snapshot.h"

namespace shiftmap::testing {

/// A map of these groups, whose positions are independent.
inline MapContent ContentOf(std::vector<LandmarkGroup> groups, Stamp stamp) {
  MapContent content;
  std::vector<Eigen::Matrix2d> diagonal;
  for (const LandmarkGroup& group : groups) {
    for (const Mode& mode : group.modes) diagonal.push_back(mode.cov_p_map_landmark);
  }
  content.groups = std::move(groups);
  content.covariance = JointCovariance(std::move(diagonal), {});
  content.stamp = stamp;
  return content;
}

}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "tools/experiment/incremental/window.h"

namespace shiftmap {

/// A sighting in the window that no mode explains.
struct UnassignedSighting {
  int frame = 0;
  int observation = 0;                                       ///< Index in the frame.
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();  ///< Where it sees the landmark. [m]
  Eigen::Matrix2d cov = Eigen::Matrix2d::Identity();         ///< Of that. [m²]
};

/// The loose sightings of a landmark that agree with the newest of them, itself included: distances
/// within `gate` variances, the errors of two sightings taken as independent.
std::vector<UnassignedSighting> AgreeingSightings(const Window& window, int group, double gate);

/// The one of least variance. Precondition: there is one.
const UnassignedSighting& SharpestSighting(const std::vector<UnassignedSighting>& sightings);

}  // namespace shiftmap

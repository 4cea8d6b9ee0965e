// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "mapstore/map/landmark_group.h"

namespace shiftmap {

/// Index into LandmarkGroup::modes of the most probable one, `absent` left out.
/// Precondition: the group has a mode.
inline std::size_t MainMode(const LandmarkGroup& group) {
  Eigen::Index mode = 0;
  group.probabilities.tail(group.probabilities.size() - 1).maxCoeff(&mode);
  return static_cast<std::size_t>(mode);
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"

namespace shiftmap {

/// One discrete position that a landmark can be at.
struct Mode {
  ModeNumber number;  ///< From 1; `absent` is never stored as a Mode.
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();      ///< [m]
  Eigen::Matrix2d cov_p_map_landmark = Eigen::Matrix2d::Zero();  ///< Marginal, order (x, y). [m²]
  Stamp last_seen;  ///< Newest observation that built this mode; the epoch for a surveyed one.
};

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>

#include "mapstore/geometry/covariance.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// A pose of a run on a map.
struct RunStart {
  std::size_t scan = 0;     ///< Of the run.
  PoseWithCovariance pose;  ///< At that scan.
};

/// Where a run is on a map: a pose that its sightings agree on (FindRecentStart), of those found in
/// the first minute of such the one with the least covariance, as a vague start gates with the
/// wrong mode. Standard deviations are twice as large as that search has them: the same sightings
/// are then used again.
/// @return Nothing if the run fits no place of the map.
std::optional<RunStart> FindRunStart(const Run& run,
                                     const MapSnapshot& map,
                                     const OdometryCalibration& odometry);

}  // namespace shiftmap

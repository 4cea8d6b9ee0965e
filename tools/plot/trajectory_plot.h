// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A trajectory to draw, in the map frame.
struct NamedTrajectory {
  std::string name;
  std::vector<StampedPose> poses;
};

/// Trajectories on a map as an SVG picture; with a truth, the position error of each over time.
/// Errors: kInvalidArgument if there is a truth, and at no time of an estimate.
StatusOr<std::string> PlotTrajectories(const MapSnapshot& map,
                                       const std::vector<NamedTrajectory>& estimates,
                                       const std::optional<NamedTrajectory>& truth);

}  // namespace shiftmap

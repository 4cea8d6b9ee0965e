// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

/// A landmark and the places it can stand at; modes[i] is mode number i + 1.
struct SimulatedGroup {
  Signature signature;
  std::vector<Eigen::Vector2d> modes;  ///< [m], in the map frame.
};

struct SimulatedRun {
  Run run;
  std::vector<StampedPose> truth;       ///< At every odometry stamp.
  std::vector<ModeNumber> active_mode;  ///< By group; kAbsent if it is away.
};

struct SimulatedWorld {
  std::vector<SimulatedGroup> groups;  ///< By ascending signature.
  std::vector<SimulatedRun> runs;      ///< By start.
};

}  // namespace shiftmap

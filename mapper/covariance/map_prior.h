// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/graph/graph.h"
#include "mapstore/map/joint_covariance.h"

namespace shiftmap {

/// What a map version tells of a graph's modes beforehand: one Gaussian of all of them that holds
/// the frame (MakeGraphPrior), or, beyond kMaxJointModes, one of each set that is correlated; these
/// know where they are in the map, and hold its frame together.
/// @param positions  Of the version's modes, the first of the graph's. [m]
std::vector<GraphPrior> MakeMapPrior(const IndexedVector<ModeIndex, Eigen::Vector2d>& positions,
                                     const JointCovariance& cov);

}  // namespace shiftmap

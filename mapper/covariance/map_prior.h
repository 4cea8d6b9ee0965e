// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/graph/graph.h"
#include "mapstore/map/joint_covariance.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// Takes what a map's scale is uncertain by out of its covariance: P' = P + sd² q qᵀ with the
/// largest sd that leaves a covariance P, sd² = 1 / qᵀP'⁻¹q. So the map is in its own units, of
/// which runs that are built on it tell nothing; with that uncertainty left in, the last of them
/// would set the scale of the whole map (mapper/METHOD.md, 3 and 9). Of a large map each tile by
/// itself, the same sd for all.
///
/// A map that knows its scale better than its sensors do, as a survey does, stays as it is.
///
/// @param sd_sensors  Of the scale that sensors get wrong together. [-]
/// @return sd; 0 if it stays. [-]
double RemoveScale(double sd_sensors, MapContent* content);

/// What a map version tells of a graph's modes beforehand: one Gaussian of all of them that holds
/// the frame (MakeGraphPrior), or, beyond kMaxJointModes, one of each set that is correlated; these
/// know where they are in the map, and hold its frame together.
/// @param positions  Of the version's modes, the first of the graph's. [m]
std::vector<GraphPrior> MakeMapPrior(const IndexedVector<ModeIndex, Eigen::Vector2d>& positions,
                                     const JointCovariance& cov);

}  // namespace shiftmap

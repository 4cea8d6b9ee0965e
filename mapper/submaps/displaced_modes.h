// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"
#include "mapper/submaps/encounter.h"
#include "mapper/submaps/submap.h"
#include "mapstore/map/joint_covariance.h"

namespace shiftmap {

/// Which modes of a submap are of landmarks that stand elsewhere than the prior map has them,
/// decided together by FindDisplaced(): for all of them at once, or where they are hundreds for
/// those of one neighbourhood after the other.
///
/// That takes a run's landmarks for linear in its errors, which they are not once they are to turn
/// by some tenths of a radian: a run that lost its heading between two rooms has the second one on
/// an arc, and on the tangent to it landmarks that stayed seem to have moved. A run that may have
/// is first bent onto what it may have met (FitBentSubmap), another if the landmarks that stayed
/// are to bend it far; and it is decided, or decided again, on what the run by itself says around
/// there, until nothing changes.
///
/// @param map         Has the prior map's modes.
/// @param alignment   By which the submap is in the map frame.
/// @param submap      In the map frame; not bent as of SubmapAlignment. Left bent as decided.
/// @param encounters  Meet() of the two, and again if the submap was bent.
/// @return Per mode of the submap, flat. False for those that meet no mode of the prior map.
std::vector<bool> FindDisplacedModes(const MapperOptions& options,
                                     const JointCovariance& prior_covariance,
                                     const MapProblem& map,
                                     const Alignment& alignment,
                                     Submap* submap,
                                     std::vector<Encounter>* encounters);

}  // namespace shiftmap

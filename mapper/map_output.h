// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/chain/group_chains.h"
#include "mapper/mapper.h"
#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"
#include "mapstore/map/joint_covariance.h"

namespace shiftmap {

/// A map, and how its chains were learned.
struct MapOutput {
  MapContent content;
  std::vector<GroupChain> chains;  ///< One per group; none if chains are not learned.
};

/// The map that a solved problem is: numbered modes, joint covariance, chains, probabilities at the
/// end of the newest run.
/// @param signatures  Of the problem's groups.
/// @param mode_covariance  Flat order of the problem. [m²]
/// Errors: kInvalidArgument, as LearnGroupChains.
StatusOr<MapOutput> MakeMapContent(const MapProblem& problem,
                                   const std::vector<Signature>& signatures,
                                   const std::optional<MapContent>& prior,
                                   const JointCovariance& mode_covariance,
                                   const MapperOptions& options);

/// What became of run `index` of a solved problem.
MappedRun MakeMappedRun(const MapProblem& problem, std::size_t index);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "mapper/chain/group_chains.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "mapstore/core/ids.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/joint_covariance.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/visibility.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A map, and how its chains were learned.
struct MapOutput {
  MapContent content;
  std::vector<GroupChain> chains;  ///< One per group; none if chains are not learned.

  /// What the visits of each run say of the groups, visits without sightings included: rows for the
  /// ledger.
  IndexedVector<RunIndex, std::vector<VisitEvidence>> evidence;

  /// The same of older runs, about modes that are new.
  std::vector<RunRecord> older;

  /// From where each run saw the modes.
  IndexedVector<RunIndex, std::vector<ModeVisibility>> visibility;
};

/// Gives groups the chains that the ledger of the options and a build's own rows support. A group
/// of which neither has visits keeps its chain if `has_own` says so of its index. Returns all
/// chains. Errors: kInvalidArgument, as LearnGroupChains.
StatusOr<std::vector<GroupChain>> LearnChains(std::vector<EvidenceRow> rows,
                                              const MapperOptions& options,
                                              const std::function<bool(std::size_t)>& has_own,
                                              std::vector<LandmarkGroup>* groups);

/// Gives each mode of a map its marginal of the joint covariance.
void SetMarginals(MapContent* content);

/// The map that a solved build is: numbered modes, joint covariance, chains, probabilities at the
/// end of the newest run, or at MapperOptions::now if that is earlier.
/// @param signatures  Of the build's groups.
/// @param mode_covariance  In the order of FlatModes. [m²]
/// Errors: kInvalidArgument, as LearnGroupChains.
StatusOr<MapOutput> MakeMapContent(const BuildState& build,
                                   const IndexedVector<GroupIndex, Signature>& signatures,
                                   const std::optional<MapContent>& prior,
                                   const JointCovariance& mode_covariance,
                                   const MapperOptions& options);

}  // namespace shiftmap

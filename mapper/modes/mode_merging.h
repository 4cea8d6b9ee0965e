// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <set>
#include <vector>

#include "mapper/covariance/mode_covariance.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "mapper/state/visit_ref.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// Two modes of a group that are one place: the second becomes the first.
struct ModeMerge {
  GroupIndex group;
  GroupModeIndex to;
  GroupModeIndex from;
};

/// Pairs of modes of one group that are not told apart by the covariance of their difference. Modes
/// of the prior map become no others, and what was displaced from them does not become them again.
/// Only where the prior map has several of a landmark, what was displaced may have been visits to
/// two of them: it is merged with one that it is nearer to than to where it was displaced to.
/// @param differences  Of the build's modes, flat order.
std::vector<ModeMerge> FindMerges(const ModeOptions& options,
                                  const ModeDifferences& differences,
                                  const BuildState& build);

/// Merges modes of one landmark of a prior map whose positions do not differ significantly: a
/// deformed run may have made one of them. Their distance and the standard deviation of their
/// difference are at most ModeOptions::position_floor_m. The mode with the smaller covariance
/// stays, of equals the one with the lower number. A mode that no run has met was stated, and is
/// not merged. Returns the number of merges.
/// @param except  Landmarks whose modes stay as they are.
int MergeModesOfPrior(const ModeOptions& options,
                      const std::set<Signature>& except,
                      MapContent* prior);

/// Remembers which modes of a group were merged in which of its states. A visit that is told apart
/// from a mode by its likelihood, but whose mode is not, would have it made and merged for ever.
class MergeMemory {
 public:
  explicit MergeMemory(const BuildState& build);

  /// Merges modes, drops what holds at no visit, and remembers it.
  void Merge(const std::vector<ModeMerge>& merges, BuildState* build);

  /// Merges what was merged before in groups that are in a state as then.
  void MergeAgain(BuildState* build) const;

 private:
  IndexedVector<GroupIndex, std::vector<VisitRef>> by_group_;
  IndexedVector<GroupIndex, std::map<std::vector<int>, std::vector<ModeMerge>>>
      merged_;  // By state.
};

/// Drops modes that hold at no visit, except those of the prior map: what holds nowhere today
/// recurs later.
void DropUnusedModes(BuildState* build);

/// A run of a build by itself with the modes that it has, none of them of a prior map.
BuildState RunByItself(const BuildState& build, RunIndex run);

/// Drops modes that explain fewer sightings than a mode needs (ModeOptions::min_sightings), except
/// those of the prior map; their visits are left unassigned. A run by itself is better aligned with
/// them, but a landmark seen once may be a misread signature, and misread ones here and there hold
/// at one mode though it explains none of the others. Returns how many modes were dropped.
int DropUnsupportedModes(const ModeOptions& options, BuildState* build);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <limits>
#include <optional>
#include <set>

#include "mapper/alignment/consensus.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Per mode of a run map, flat, the mode of its group in the map that it is, or kUnassigned.
using KnownModes = IndexedVector<ModeIndex, OptionalMode>;

/// How many are known.
int CountKnown(const KnownModes& known);

/// Something that holds or not for each mode of a run map, flat.
using ModeFlags = IndexedVector<ModeIndex, bool>;

/// Where a map has the modes of a run map, flat, or nothing. [m]
using ModePlaces = IndexedVector<ModeIndex, std::optional<Eigen::Vector2d>>;

/// Per mode of a build, flat.
IndexedVector<ModeIndex, GroupIndex> GroupsOfModes(const BuildState& build);

/// Modes that count.
using ModeFilter = std::function<bool(GroupIndex, GroupModeIndex)>;

/// The modes that a map has of some groups, in flat order, without covariance.
/// @param counts  Null: all.
AlignmentPoints PointsOfGroups(const BuildState& map,
                               const std::set<GroupIndex>& groups,
                               const ModeFilter& counts = {});

/// The mode of a group that is nearest to a point.
struct NearestMode {
  OptionalMode mode = kUnassigned;  ///< kUnassigned: the group has none.
  double squared_m2 = std::numeric_limits<double>::infinity();
};

/// @param counts  Null: all.
NearestMode FindNearest(const BuildState& map,
                        GroupIndex group,
                        const Eigen::Vector2d& point,
                        const ModeFilter& counts = {});

/// A mode of a run map beside the mode of its group that is nearest to it in the map.
struct ModeMatch {
  GroupIndex group;
  Eigen::Vector2d position;  ///< [m]
  NearestMode nearest;
  BuildMode known;        ///< The nearest one.
  bool is_prior = false;  ///< It is one of the prior map.
};

using ModeMatches = IndexedVector<ModeIndex, ModeMatch>;

/// All modes of a run map, in flat order.
/// @param run_map  In the frame of the map.
ModeMatches MatchNearest(const BuildState& run_map, const BuildState& map);

}  // namespace shiftmap

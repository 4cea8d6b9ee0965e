// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/mode_match.h"

#include <algorithm>

namespace shiftmap {

int CountKnown(const KnownModes& known) {
  return static_cast<int>(std::ssize(known) - std::count(known.begin(), known.end(), kUnassigned));
}

IndexedVector<ModeIndex, GroupIndex> GroupsOfModes(const BuildState& build) {
  IndexedVector<ModeIndex, GroupIndex> groups;
  for (const GroupIndex group : build.modes.indices()) {
    groups.insert(groups.end(), build.modes[group].size(), group);
  }
  return groups;
}

AlignmentPoints PointsOfGroups(const BuildState& map,
                               const std::set<GroupIndex>& groups,
                               const ModeFilter& counts) {
  AlignmentPoints points;
  for (const GroupIndex group : groups) {
    for (const GroupModeIndex mode : map.modes[group].indices()) {
      if (counts && !counts(group, mode)) continue;
      points.push_back({group, map.modes[group][mode].p_map_landmark});
    }
  }
  return points;
}

NearestMode FindNearest(const BuildState& map,
                        GroupIndex group,
                        const Eigen::Vector2d& point,
                        const ModeFilter& counts) {
  NearestMode nearest;
  for (const GroupModeIndex mode : map.modes[group].indices()) {
    const double squared = (map.modes[group][mode].p_map_landmark - point).squaredNorm();
    if (squared >= nearest.squared_m2 || (counts && !counts(group, mode))) continue;
    nearest = {mode, squared};
  }
  return nearest;
}

ModeMatches MatchNearest(const BuildState& run_map, const BuildState& map) {
  ModeMatches matches;
  for (const GroupIndex group : run_map.modes.indices()) {
    for (const BuildMode& mode : run_map.modes[group]) {
      ModeMatch& match = matches.emplace_back();
      match.group = group;
      match.position = mode.p_map_landmark;
      match.nearest = FindNearest(map, group, match.position);
      if (!match.nearest.mode) continue;
      match.known = map.modes[group][*match.nearest.mode];
      match.is_prior = match.known.number != kAbsent;
    }
  }
  return matches;
}

}  // namespace shiftmap

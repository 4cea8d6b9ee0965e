// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/waiting_run_maps.h"

#include <utility>

#include "mapper/registration/mode_match.h"

namespace shiftmap {

WaitingRunMaps::WaitingRunMaps(IndexedVector<RunMapIndex, RunMap> run_maps, const BuildState& build)
    : entries_(run_maps.size()),
      with_group_(build.modes.size()),
      modes_of_group_(build.modes.size()) {
  for (const RunMapIndex i : run_maps.indices()) {
    Entry& entry = entries_[i];
    for (const AlignmentPoint& point : run_maps[i].points) {
      if (entry.groups.insert(point.group).second) with_group_[point.group].push_back(i);
    }
    entry.run_map = std::move(run_maps[i]);
  }
  for (const GroupIndex group : build.modes.indices()) Count(group, build);
}

template <typename Value>
std::optional<RunMapIndex> WaitingRunMaps::FirstWithMost(const Value& value) const {
  std::optional<RunMapIndex> first;
  std::size_t most = 0;
  for (const RunMapIndex i : entries_.indices()) {
    if (!entries_[i].run_map) continue;
    const std::size_t at = value(entries_[i]);
    if (at <= most) continue;
    most = at;
    first = i;
  }
  return first;
}

std::optional<RunMapIndex> WaitingRunMaps::Largest() const {
  return FirstWithMost([](const Entry& entry) { return entry.run_map->points.size() + 1; });
}

std::optional<RunMapIndex> WaitingRunMaps::Next() const {
  const auto untried = FirstWithMost([](const Entry& entry) -> std::size_t {
    return entry.tried_with_modes == 0 ? entry.shared : 0;
  });
  if (untried) return untried;
  return FirstWithMost([](const Entry& entry) -> std::size_t {
    return entry.modes > entry.tried_with_modes ? entry.shared : 0;
  });
}

void WaitingRunMaps::SetAside(RunMapIndex i, std::optional<Explanations> explanations) {
  entries_[i].tried_with_modes = entries_[i].modes;
  entries_[i].explanations = std::move(explanations);
}

RunMap WaitingRunMaps::Take(RunMapIndex i) {
  RunMap run_map = std::move(*entries_[i].run_map);
  entries_[i].run_map.reset();
  return run_map;
}

void WaitingRunMaps::Update(RunMapIndex i, const BuildState& build) {
  for (const GroupIndex group : entries_[i].groups) Count(group, build);
}

void WaitingRunMaps::Count(GroupIndex group, const BuildState& build) {
  const std::size_t now = build.modes[group].size();
  const std::size_t before = std::exchange(modes_of_group_[group], now);
  if (now == before) return;
  for (const RunMapIndex i : with_group_[group]) {
    Entry& entry = entries_[i];
    entry.modes = entry.modes - before + now;
    if (before == 0) ++entry.shared;
    if (now == 0) --entry.shared;
  }
}

void WaitingRunMaps::Recount(const BuildState& build) {
  for (const GroupIndex group : build.modes.indices()) Count(group, build);
  for (Entry& entry : entries_) entry.tried_with_modes = 0;
}

AlignmentPoints WaitingRunMaps::Reference(RunMapIndex i, const BuildState& build) const {
  return PointsOfGroups(build, entries_[i].groups);
}

std::vector<RunMapIndex> WaitingRunMaps::Remaining() const {
  std::vector<RunMapIndex> remaining;
  for (const RunMapIndex i : entries_.indices()) {
    if (entries_[i].run_map) remaining.push_back(i);
  }
  return remaining;
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/waiting_run_maps.h"

#include <algorithm>
#include <utility>

namespace shiftmap {

WaitingRunMaps::WaitingRunMaps(std::vector<RunMap> run_maps, const BuildState& build)
    : entries_(run_maps.size()),
      with_group_(build.modes.size()),
      modes_of_group_(build.modes.size()) {
  for (std::size_t i = 0; i < run_maps.size(); ++i) {
    Entry& entry = entries_[i];
    // Points are by group.
    for (const AlignmentPoint& point : run_maps[i].points) {
      if (!entry.groups.empty() && entry.groups.back() == point.group) continue;
      entry.groups.push_back(point.group);
      with_group_[point.group].push_back(i);
    }
    entry.run_map = std::move(run_maps[i]);
  }
  for (const GroupIndex group : build.modes.indices()) Count(group, build);
}

template <typename Value>
std::optional<std::size_t> WaitingRunMaps::FirstWithMost(const Value& value) const {
  std::optional<std::size_t> first;
  std::size_t most = 0;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (!entries_[i].run_map) continue;
    const std::size_t at = value(entries_[i]);
    if (at <= most) continue;
    most = at;
    first = i;
  }
  return first;
}

std::optional<std::size_t> WaitingRunMaps::Largest() const {
  return FirstWithMost([](const Entry& entry) { return entry.run_map->points.size() + 1; });
}

std::optional<std::size_t> WaitingRunMaps::Next() const {
  const auto untried = FirstWithMost([](const Entry& entry) -> std::size_t {
    return entry.tried_with_modes == 0 ? entry.shared : 0;
  });
  if (untried) return untried;
  return FirstWithMost([](const Entry& entry) -> std::size_t {
    return entry.modes > entry.tried_with_modes ? entry.shared : 0;
  });
}

void WaitingRunMaps::SetAside(std::size_t i, std::optional<Explanations> explanations) {
  entries_[i].tried_with_modes = entries_[i].modes;
  entries_[i].explanations = std::move(explanations);
}

RunMap WaitingRunMaps::Take(std::size_t i) {
  RunMap run_map = std::move(*entries_[i].run_map);
  entries_[i].run_map.reset();
  return run_map;
}

void WaitingRunMaps::Update(std::size_t i, const BuildState& build) {
  for (const GroupIndex group : entries_[i].groups) Count(group, build);
}

void WaitingRunMaps::Count(GroupIndex group, const BuildState& build) {
  const std::size_t now = build.modes[group].size();
  const std::size_t before = std::exchange(modes_of_group_[group], now);
  if (now == before) return;
  for (const std::size_t i : with_group_[group]) {
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

AlignmentPoints WaitingRunMaps::Reference(std::size_t i, const BuildState& build) const {
  AlignmentPoints points;
  for (const GroupIndex group : entries_[i].groups) {
    for (const BuildMode& mode : build.modes[group]) {
      points.push_back({group, mode.p_map_landmark, Eigen::Matrix2d::Zero()});
    }
  }
  return points;
}

std::vector<std::size_t> WaitingRunMaps::Remaining() const {
  std::vector<std::size_t> remaining;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (entries_[i].run_map) remaining.push_back(i);
  }
  return remaining;
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/waiting_submaps.h"

#include <algorithm>
#include <utility>

namespace shiftmap {

WaitingSubmaps::WaitingSubmaps(std::vector<Submap> submaps, const MapProblem& problem)
    : entries_(submaps.size()),
      with_group_(problem.modes.size()),
      modes_of_group_(problem.modes.size()) {
  for (std::size_t i = 0; i < submaps.size(); ++i) {
    Entry& entry = entries_[i];
    // Points are by group.
    for (const AlignmentPoint& point : submaps[i].points) {
      if (!entry.groups.empty() && entry.groups.back() == point.group) continue;
      entry.groups.push_back(point.group);
      with_group_[static_cast<std::size_t>(point.group)].push_back(i);
    }
    entry.submap = std::move(submaps[i]);
  }
  for (std::size_t group = 0; group < problem.modes.size(); ++group) Count(group, problem);
}

template <typename Value>
std::optional<std::size_t> WaitingSubmaps::FirstWithMost(const Value& value) const {
  std::optional<std::size_t> first;
  std::size_t most = 0;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (!entries_[i].submap) continue;
    const std::size_t at = value(entries_[i]);
    if (at <= most) continue;
    most = at;
    first = i;
  }
  return first;
}

std::optional<std::size_t> WaitingSubmaps::Largest() const {
  return FirstWithMost([](const Entry& entry) { return entry.submap->points.size() + 1; });
}

std::optional<std::size_t> WaitingSubmaps::Next() const {
  const auto untried = FirstWithMost([](const Entry& entry) -> std::size_t {
    return entry.tried_with_modes == 0 ? entry.shared : 0;
  });
  if (untried) return untried;
  return FirstWithMost([](const Entry& entry) -> std::size_t {
    return entry.modes > entry.tried_with_modes ? entry.shared : 0;
  });
}

void WaitingSubmaps::SetAside(std::size_t i, std::optional<Explanations> explanations) {
  entries_[i].tried_with_modes = entries_[i].modes;
  entries_[i].explanations = std::move(explanations);
}

Submap WaitingSubmaps::Take(std::size_t i) {
  Submap submap = std::move(*entries_[i].submap);
  entries_[i].submap.reset();
  return submap;
}

void WaitingSubmaps::Update(std::size_t i, const MapProblem& problem) {
  for (const int group : entries_[i].groups) Count(static_cast<std::size_t>(group), problem);
}

void WaitingSubmaps::Count(std::size_t group, const MapProblem& problem) {
  const std::size_t now = problem.modes[group].size();
  const std::size_t before = std::exchange(modes_of_group_[group], now);
  if (now == before) return;
  for (const std::size_t i : with_group_[group]) {
    Entry& entry = entries_[i];
    entry.modes = entry.modes - before + now;
    if (before == 0) ++entry.shared;
    if (now == 0) --entry.shared;
  }
}

void WaitingSubmaps::Recount(const MapProblem& problem) {
  for (std::size_t group = 0; group < problem.modes.size(); ++group) Count(group, problem);
  for (Entry& entry : entries_) entry.tried_with_modes = 0;
}

std::vector<AlignmentPoint> WaitingSubmaps::Reference(std::size_t i,
                                                      const MapProblem& problem) const {
  std::vector<AlignmentPoint> points;
  for (const int group : entries_[i].groups) {
    for (const BuildMode& mode : problem.modes[static_cast<std::size_t>(group)]) {
      points.push_back({group, mode.p_map_landmark, Eigen::Matrix2d::Zero()});
    }
  }
  return points;
}

std::vector<std::size_t> WaitingSubmaps::Remaining() const {
  std::vector<std::size_t> remaining;
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    if (entries_[i].submap) remaining.push_back(i);
  }
  return remaining;
}

}  // namespace shiftmap

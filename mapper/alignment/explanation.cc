// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/explanation.h"

#include <algorithm>
#include <cmath>
#include <functional>

namespace shiftmap {
namespace {

// Groups whose probability of having stayed differs by this between two frames decide between them.
constexpr double kDecidingDifference = 0.5;

std::vector<GroupIndex> Deciding(const Explanation& x, const Explanation& y) {
  std::vector<GroupIndex> deciding;
  for (std::size_t i = 0; i < x.given.stays.size(); ++i) {
    const auto& [group, stays] = x.given.stays[i];
    if (std::abs(stays - y.given.stays[i].second) > kDecidingDifference) deciding.push_back(group);
  }
  return deciding;
}

}  // namespace

std::vector<StayedSet> ByFallingProbability(const StayedSets& sets) {
  std::vector<StayedSet> sorted;
  for (const auto& [groups, probability] : sets) sorted.push_back({groups, probability});
  std::ranges::stable_sort(sorted, std::greater(), &StayedSet::probability);
  return sorted;
}

Explanation DescribeFrame(const StayedSets& sets,
                          const std::vector<GroupIndex>& likeliest,
                          const std::vector<GroupIndex>& groups) {
  Explanation explanation;
  for (const auto& [stayed, probability] : sets) explanation.probability += probability;
  StayedSets likely;
  std::map<GroupIndex, double> stays;
  for (const GroupIndex group : groups) stays[group] = 0.0;
  for (const auto& [stayed, probability] : sets) {
    const double share = probability / explanation.probability;
    if (share >= kUnlikely) likely[stayed] = share;
    for (const GroupIndex group : stayed) stays[group] += share;
  }
  explanation.given.alternatives = ByFallingProbability(likely);
  explanation.given.stays.assign(stays.begin(), stays.end());
  explanation.alignment.signatures = likeliest;
  for (const auto& [group, probability] : stays) {
    if (!std::ranges::binary_search(likeliest, group)) explanation.moved.push_back(group);
  }
  return explanation;
}

Explanations BySets(const Explanation& frame) {
  std::vector<GroupIndex> groups;
  for (const auto& [group, stays] : frame.given.stays) groups.push_back(group);
  std::vector<Explanation> sets;
  for (const StayedSet& set : frame.given.alternatives) {
    sets.push_back(
        DescribeFrame({{set.groups, set.probability * frame.probability}}, set.groups, groups));
  }
  return DescribeFrames(std::move(sets));
}

Explanations DescribeFrames(std::vector<Explanation> frames) {
  std::ranges::stable_sort(frames, std::greater(), &Explanation::probability);
  Explanations explanations;
  if (frames.size() > 1) explanations.deciding = Deciding(frames[0], frames[1]);
  explanations.frames = std::move(frames);
  return explanations;
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/keep_alternatives.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "mapper/modes/unconstrained_runs.h"

namespace shiftmap {
namespace {

// The sets that differ in landmarks in doubt; of the others the first says whether they stayed.
std::vector<StayedSet> SetsInDoubt(const std::vector<StayedSet>& all,
                                   const KeptAlternatives& kept) {
  StayedSets sets;
  for (const StayedSet& set : all) {
    std::set<GroupIndex> stayed(all.front().groups.begin(), all.front().groups.end());
    for (const KeptAlternatives::Doubt& doubt : kept.doubts) {
      stayed.erase(doubt.group);
      if (std::binary_search(set.groups.begin(), set.groups.end(), doubt.group)) {
        stayed.insert(doubt.group);
      }
    }
    sets[{stayed.begin(), stayed.end()}] += set.probability;
  }
  return ByFallingProbability(sets);
}

}  // namespace

bool IsInDoubt(const KeptAlternatives& kept, GroupIndex group) {
  return std::any_of(kept.doubts.begin(), kept.doubts.end(), [&](const auto& doubt) {
    return doubt.group == group;
  });
}

std::optional<KeptAlternatives> KeepAlternatives(const StayedPosterior& frame,
                                                 double decided,
                                                 const ModeFlags& apart,
                                                 const RunMap& run_map,
                                                 const ModeMatches& matches,
                                                 KnownModes* known) {
  const std::map<GroupIndex, double> stays(frame.stays.begin(), frame.stays.end());
  KeptAlternatives kept;
  KnownModes without = *known;
  for (const ModeIndex i : matches.indices()) {
    const ModeMatch& match = matches[i];
    const auto stay = stays.find(match.group);
    if (stay == stays.end() || !match.nearest.mode || !apart[i]) continue;
    if (!LeavesDoubt(stay->second, decided)) continue;
    without[i] = kUnassigned;
    kept.doubts.push_back({match.group, match.known.p_map_landmark, stay->second});
  }
  if (kept.doubts.empty() || CountKnown(without) < kMinTyingModes) return std::nullopt;
  *known = std::move(without);
  for (const BuildRun& run : run_map.build.runs) {
    kept.runs.push_back({run.data->name, run.data->sha256});
  }
  kept.alternatives = SetsInDoubt(frame.alternatives, kept);
  for (const auto& [group, probability] : stays) kept.groups.push_back(group);
  return kept;
}

}  // namespace shiftmap

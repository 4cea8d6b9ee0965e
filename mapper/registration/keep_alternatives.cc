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
                                                 const std::vector<bool>& apart,
                                                 const RunMap& run_map,
                                                 const std::vector<ModeMatch>& mode_matches,
                                                 const BuildState& build,
                                                 std::vector<OptionalMode>* known) {
  const std::map<GroupIndex, double> stays(frame.stays.begin(), frame.stays.end());
  KeptAlternatives kept;
  std::vector<OptionalMode> without = *known;
  for (std::size_t i = 0; i < mode_matches.size(); ++i) {
    const ModeMatch& mode_match = mode_matches[i];
    const auto stay = stays.find(mode_match.group);
    if (stay == stays.end() || !mode_match.nearest || !apart[i]) continue;
    if (!LeavesDoubt(stay->second, decided)) continue;
    without[i] = kUnassigned;
    kept.doubts.push_back(
        {mode_match.group, NearestMode(build, mode_match).p_map_landmark, stay->second});
  }
  const auto left = std::ssize(without) - std::count(without.begin(), without.end(), kUnassigned);
  if (kept.doubts.empty() || left < kMinTyingModes) return std::nullopt;
  *known = std::move(without);
  for (const BuildRun& run : run_map.build.runs) {
    kept.runs.push_back({run.data->name, run.data->sha256});
  }
  kept.alternatives = SetsInDoubt(frame.alternatives, kept);
  for (const auto& [group, probability] : stays) kept.groups.push_back(group);
  return kept;
}

}  // namespace shiftmap

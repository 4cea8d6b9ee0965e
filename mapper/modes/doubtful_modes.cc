// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/doubtful_modes.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace shiftmap {
namespace {

bool IsOf(const KeptAlternatives& kept, const std::string& sha256) {
  return std::any_of(
      kept.runs.begin(), kept.runs.end(), [&](const RunName& run) { return run.sha256 == sha256; });
}

// The mode of a group that is nearest to a place. Precondition: there is one.
GroupModeIndex NearestTo(const Eigen::Vector2d& place, const GroupModes& modes) {
  const auto nearest =
      std::min_element(modes.begin(), modes.end(), [&](const BuildMode& a, const BuildMode& b) {
        return (a.p_map_landmark - place).squaredNorm() < (b.p_map_landmark - place).squaredNorm();
      });
  return GroupModeIndex(nearest - modes.begin());
}

// Whether a visit is of a landmark in doubt, at another mode than that which it may have left.
bool IsInDoubt(const BuildState& build,
               const VisitRef& visit,
               const KeptAlternatives::Doubt& doubt) {
  const OptionalMode assigned = AssignmentOf(build, visit);
  return VisitOf(build, visit).group == doubt.group && assigned &&
         assigned != NearestTo(doubt.place, build.modes[doubt.group]);
}

}  // namespace

void MixAlternatives(const BuildState& build,
                     const VisitRef& visit,
                     Eigen::VectorXd* log_likelihoods) {
  const std::string& sha256 = build.runs[visit.run].data->sha256;
  for (const KeptAlternatives& kept : build.kept) {
    if (!IsOf(kept, sha256)) continue;
    for (const KeptAlternatives::Doubt& doubt : kept.doubts) {
      if (!IsInDoubt(build, visit, doubt)) continue;
      const GroupModeIndex left = NearestTo(doubt.place, build.modes[doubt.group]);
      (*log_likelihoods)[StateOf(left)] = (*log_likelihoods)[StateOf(AssignmentOf(build, visit))] +
                                          std::log(doubt.stayed) - std::log1p(-doubt.stayed);
    }
  }
}

void DropSettledAlternatives(BuildState* build) {
  for (KeptAlternatives& kept : build->kept) {
    std::erase_if(kept.doubts, [&](const KeptAlternatives::Doubt& doubt) {
      for (const RunIndex r : build->runs.indices()) {
        const BuildRun& run = build->runs[r];
        if (!IsOf(kept, run.data->sha256)) continue;
        for (const VisitIndex v : run.assignment.indices()) {
          if (IsInDoubt(*build, {r, v}, doubt)) return false;
        }
      }
      return true;
    });
  }
  std::erase_if(build->kept, [](const KeptAlternatives& kept) { return kept.doubts.empty(); });
}

}  // namespace shiftmap

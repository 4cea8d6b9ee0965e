// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/selection_summary.h"

#include <vector>

#include "mapper/modes/mode_refinement.h"
#include "mapper/selection/forward_backward.h"
#include "mapper/selection/viterbi.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

SelectionSummary SummarizeSelection(const ModeOptions& options, const BuildState& build) {
  SelectionSummary summary;
  const auto by_group = VisitsByGroup(build);
  for (const GroupIndex group : by_group.indices()) {
    const std::vector<VisitRef>& visits = by_group[group];
    if (visits.empty()) continue;
    const ModeSequenceProblem sequence = MakeGroupSequence(build, visits, group, options);
    const ModePosteriors posteriors = SmoothModes(sequence);
    std::vector<int> states;
    for (std::size_t t = 0; t < visits.size(); ++t) {
      const int state = StateOf(AssignmentOf(build, visits[t]));
      states.push_back(state);
      const double posterior = posteriors.probabilities(static_cast<Eigen::Index>(t), state);
      summary.uncertain_visits += posterior < kSureProbability ? 1 : 0;
    }
    summary.visits += static_cast<int>(visits.size());
    summary.log_joint += LogJoint(sequence, states);
    summary.best_log_joint += LogJoint(sequence, MostLikelyModes(sequence));
  }
  return summary;
}

}  // namespace shiftmap

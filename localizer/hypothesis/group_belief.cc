// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/group_belief.h"

#include "localizer/models/detection_model.h"

namespace shiftmap {

void AddMiss(
    int state, double log_miss, double occluded, GroupBelief* belief, double* log_likelihood) {
  double& run = belief->log_missed[static_cast<std::size_t>(state)];
  *log_likelihood += LogMissedRun(run + log_miss, occluded) - LogMissedRun(run, occluded);
  run += log_miss;
}

double Normalize(GroupBelief* belief) {
  const double total = LogSumExp(AsVector(belief->log_p));
  if (total != kLogZero) AsVector(belief->log_p).array() -= total;
  return total;
}

void MixStates(double log_share_into,
               double log_share_from,
               const GroupBelief& other,
               GroupBelief* belief) {
  for (int state = 0; state < belief->states(); ++state) {
    belief->log_p[static_cast<std::size_t>(state)] =
        LogAdd(log_share_into + belief->LogProbability(state),
               log_share_from + other.LogProbability(state));
  }
  belief->resolved = GroupBelief::kUnresolved;
}

}  // namespace shiftmap

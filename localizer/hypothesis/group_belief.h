// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>

#include "localizer/hypothesis/log_math.h"
#include "localizer/hypothesis/state_values.h"
#include "mapstore/map/calibration.h"

namespace shiftmap {

/// What one leaf holds about one group.
///
/// Either a mode (or `absent`) is *resolved*: the leaf is the hypothesis that it holds; or the leaf
/// stands for several states that share its filter, because no observation has told their poses
/// apart (T-IV VI-A, for every mode and not only for the alternative hypothesis).
struct GroupBelief {
  static constexpr int kUnresolved = -1;

  int group = 0;               ///< Index of the group.
  int resolved = kUnresolved;  ///< State 0..n.
  StateValues log_p;           ///< Unresolved: log-probability per state given the leaf, sums to 1.
  StateValues log_missed;      ///< Σ log(1 - P_D) of the present run of misses, per state.

  int states() const { return static_cast<int>(log_p.size()); }

  double LogProbability(int state) const {
    if (resolved == kUnresolved) return log_p[static_cast<std::size_t>(state)];
    return state == resolved ? 0.0 : kLogZero;
  }
};

/// Adds one missed detection to what `log_likelihood` says for a state: a landmark that is there is
/// occluded for the whole of a visit with probability `occluded` (LogMissedRun).
/// @param log_miss  log(1 - P_D) of this scan.
void AddMiss(
    int state, double log_miss, double occluded, GroupBelief* belief, double* log_likelihood);

/// The same for every mode that a leaf holds possible, in its belief or, if that is resolved, in
/// its weight. Not normalized.
/// @param in_view  P_FOV of a state >= 1.
template <class InView>
void MissModes(const SensorCalibration& sensor,
               const InView& in_view,
               GroupBelief* belief,
               double* log_weight) {
  for (int state = 1; state < belief->states(); ++state) {
    if (belief->LogProbability(state) == kLogZero) continue;
    const double probability = in_view(state);
    if (probability == 0.0) continue;
    AddMiss(state,
            std::log1p(-sensor.detection_probability * probability),
            sensor.occluded_visit_probability,
            belief,
            belief->resolved == GroupBelief::kUnresolved
                ? &belief->log_p[static_cast<std::size_t>(state)]
                : log_weight);
  }
}

/// Makes the probabilities of an unresolved belief sum to 1; returns the log of their sum before.
double Normalize(GroupBelief* belief);

/// Adds `other`, of a leaf that is merged, to `belief`. Shares: log-weights of the two leaves over
/// that of both.
void MixStates(double log_share_into,
               double log_share_from,
               const GroupBelief& other,
               GroupBelief* belief);

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "localizer/hypothesis/hypothesis_bank.h"
#include "mapstore/map/estimate.h"
#include "tools/experiment/simulated_visit.h"

namespace shiftmap {

/// What became of the decisions over many simulated visits.
struct DecisionTally {
  std::int64_t groups = 0;   ///< Groups seen at least once.
  std::int64_t decided = 0;  ///< Of those.
  std::int64_t wrong = 0;    ///< First decisions for a state that is not the true one.

  /// Over decisions for a mode: scans with an observation of the group up to the decision, and
  /// Wald's bound on their mean.
  std::int64_t decided_modes = 0;
  double observations = 0.0;
  double wald_observations = 0.0;

  double WrongShare() const;
  ShareEstimate Wrong() const;  ///< For its interval.
  double UndecidedShare() const;
  double MeanDelay() const;
  double WaldDelay() const;
  void Add(const DecisionTally& other);
};

/// A first decision in a visit.
struct VisitDecision {
  int group = 0;
  int state = 0;
  int scan = 0;
};

/// The first decision of the bank for each group that it decided.
std::vector<VisitDecision> DecideVisit(const SimulatedVisit& visit,
                                       const HypothesisOptions& options);

/// The least mean number of observations with which any test that is wrong with probability α tells
/// the true mode from the nearest other one, by Wald: (1 - 2α) log((1 - α)/α), less the log-odds of
/// the prior, over the mean information of an observation, for one who knows map, pose and bias.
/// At least 1.
double WaldObservations(const SimulatedVisit& visit, int group, double alpha);

/// Tallies the decisions over visits with the seeds `first_seed`, `first_seed` + 1, …
/// Determinism: independent of the number of threads.
DecisionTally TallyDecisions(const VisitScene& scene,
                             const HypothesisOptions& options,
                             std::uint64_t first_seed,
                             int visits,
                             int threads);

}  // namespace shiftmap

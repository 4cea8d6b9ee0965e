// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_decisions.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "localizer/hypothesis/sequential_test.h"
#include "localizer/models/observation_model.h"
#include "mapper/parallel.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr int kVisitsPerBatch = 100;

double Ratio(double part, double whole) {
  return whole > 0.0 ? part / whole : std::numeric_limits<double>::quiet_NaN();
}

bool Sees(const Scan& scan, const Signature& signature) {
  return std::any_of(scan.observations.begin(),
                     scan.observations.end(),
                     [&](const Observation& other) { return other.signature == signature; });
}

// Scans up to `scan` in which the group was seen.
int ObservationsUpTo(const SimulatedVisit& visit, int group, int scan) {
  const Signature& signature = visit.content.groups[static_cast<std::size_t>(group)].signature;
  return static_cast<int>(std::count_if(visit.scans.begin(),
                                        visit.scans.begin() + scan + 1,
                                        [&](const Scan& other) { return Sees(other, signature); }));
}

DecisionTally TallyVisit(const SimulatedVisit& visit, const HypothesisOptions& options) {
  DecisionTally tally;
  for (int group = 0; group < static_cast<int>(visit.true_states.size()); ++group) {
    const int last = static_cast<int>(visit.scans.size()) - 1;
    tally.groups += ObservationsUpTo(visit, group, last) > 0;
  }
  for (const VisitDecision& decision : DecideVisit(visit, options)) {
    const int truth = visit.true_states[static_cast<std::size_t>(decision.group)];
    ++tally.decided;
    tally.wrong += decision.state != truth;
    if (decision.state == 0 || truth == 0) continue;
    ++tally.decided_modes;
    tally.observations += ObservationsUpTo(visit, decision.group, decision.scan);
    tally.wald_observations += WaldObservations(visit, decision.group, options.alpha);
  }
  return tally;
}

}  // namespace

double DecisionTally::WrongShare() const {
  return Ratio(static_cast<double>(wrong), static_cast<double>(decided));
}

ShareEstimate DecisionTally::Wrong() const { return {WrongShare(), static_cast<double>(decided)}; }

double DecisionTally::UndecidedShare() const {
  return Ratio(static_cast<double>(groups - decided), static_cast<double>(groups));
}

double DecisionTally::MeanDelay() const {
  return Ratio(observations, static_cast<double>(decided_modes));
}

double DecisionTally::WaldDelay() const {
  return Ratio(wald_observations, static_cast<double>(decided_modes));
}

void DecisionTally::Add(const DecisionTally& other) {
  groups += other.groups;
  decided += other.decided;
  wrong += other.wrong;
  decided_modes += other.decided_modes;
  observations += other.observations;
  wald_observations += other.wald_observations;
}

std::vector<VisitDecision> DecideVisit(const SimulatedVisit& visit,
                                       const HypothesisOptions& options) {
  const MapSnapshot snapshot("area", VersionNumber(1), "", visit.content);
  HypothesisBank bank(snapshot, options, visit.start, VisitStamp(-1));
  std::vector<VisitDecision> first;
  for (std::size_t i = 0; i < visit.scans.size(); ++i) {
    bank.Predict(visit.motions[i], visit.elapsed_s[i]);
    for (const auto& [decision, surprising] : bank.Correct(visit.scans[i]).decisions) {
      const int group = snapshot.GroupIndex(decision.signature);
      const bool again = std::any_of(first.begin(), first.end(), [&](const VisitDecision& other) {
        return other.group == group;
      });
      const int state = static_cast<int>(decision.mode.value());
      if (!again) first.push_back({group, state, static_cast<int>(i)});
    }
  }
  return first;
}

double WaldObservations(const SimulatedVisit& visit, int group, double alpha) {
  const auto index = static_cast<std::size_t>(group);
  const LandmarkGroup& landmark = visit.content.groups[index];
  const int truth = visit.true_states[index];
  const Eigen::Vector2d& p_true =
      landmark.modes[static_cast<std::size_t>(truth) - 1].p_map_landmark;
  double most = 1.0;
  for (int state = 1; state <= static_cast<int>(landmark.modes.size()); ++state) {
    if (state == truth) continue;
    const Eigen::Vector2d& p = landmark.modes[static_cast<std::size_t>(state) - 1].p_map_landmark;
    double information = 0.0;
    int observations = 0;
    for (std::size_t i = 0; i < visit.scans.size(); ++i) {
      if (!Sees(visit.scans[i], landmark.signature)) continue;
      const Se2 T_vehicle_map = visit.T_map_vehicle[i].Inverse();
      Observation expected;
      const Eigen::Vector2d q = T_vehicle_map * p_true;
      expected.z = {q.norm(), std::atan2(q.y(), q.x())};
      const Innovation innovation = Linearize(expected, visit.T_map_vehicle[i], p);
      const Eigen::Matrix2d R = ObservationNoise(expected, visit.content.calibration.sensor);
      information += 0.5 * SquaredMahalanobis(innovation.nu, R);
      ++observations;
    }
    const double needed = (1.0 - 2.0 * alpha) * DecisionThreshold(alpha) -
                          std::log(landmark.probabilities[truth] / landmark.probabilities[state]);
    if (observations > 0) most = std::max(most, needed * observations / information);
  }
  return most;
}

DecisionTally TallyDecisions(const VisitScene& scene,
                             const HypothesisOptions& options,
                             std::uint64_t first_seed,
                             int visits,
                             int threads) {
  const int batches = (visits + kVisitsPerBatch - 1) / kVisitsPerBatch;
  std::vector<DecisionTally> tallies(static_cast<std::size_t>(batches));
  ForEachIndex(tallies.size(), threads, [&](std::size_t batch) {
    const int begin = static_cast<int>(batch) * kVisitsPerBatch;
    for (int i = begin; i < std::min(visits, begin + kVisitsPerBatch); ++i) {
      const SimulatedVisit visit = SimulateVisit(scene, first_seed + static_cast<std::uint64_t>(i));
      tallies[batch].Add(TallyVisit(visit, options));
    }
  });
  DecisionTally total;
  for (const DecisionTally& tally : tallies) total.Add(tally);
  return total;
}

}  // namespace shiftmap

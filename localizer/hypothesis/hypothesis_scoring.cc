// SPDX-License-Identifier: Apache-2.0
//
// How observations and misses weigh the leaves, T-IV (20) and (22-24).
#include <algorithm>
#include <cmath>
#include <utility>

#include "localizer/hypothesis/hypothesis_bank.h"
#include "localizer/models/detection_model.h"
#include "localizer/models/observation_model.h"

namespace shiftmap {
namespace {

// A detector now and then misjudges what it does see: this share of the detections of a landmark
// has errors of that many standard deviations (MRCLAM: 0.2 to 4.5 % are beyond 5). Without this
// tail a few misjudged ranges prove a landmark gone, or at another mode near by.
constexpr double kMisjudgedShare = 0.03;
constexpr double kMisjudgedSigmas = 6.0;

// A mode whose innovation is farther out starts no leaf: it would weigh e⁻²⁰ of others. [-]
constexpr double kMaxForkNis = 40.0;

// Errors of consecutive observations from one place are alike (the same misjudged edge of the same
// image): a repetition weighs a quarter, as if its likelihood were raised to that power.
constexpr double kRepetitionWeight = 0.25;
constexpr double kSameViewDistance = 0.1;  // [m]
constexpr double kSameViewYaw = 0.05;      // [rad]

/// Log-densities, in the observation's own units, of causes other than a known mode.
struct ClutterDensity {
  double log_false_alarm = 0.0;  // β_FA
  double log_any = 0.0;          // β_FA + β_NT: `absent` leaves both open.
};

ClutterDensity ClutterOf(const Observation& observation, const SensorCalibration& sensor) {
  const double unit = SquareMetresPerUnit(observation);
  const double any = sensor.clutter_density_per_m2 + sensor.new_landmark_density_per_m2;
  return {std::log(sensor.clutter_density_per_m2 * unit), std::log(any * unit)};
}

}  // namespace

double HypothesisBank::LogMiss(const Leaf& leaf, int group, int state) const {
  const SensorCalibration& sensor = snapshot_.calibration().sensor;
  const KnownMapFilter::Point point = leaf.filter.PredictPoint({group, state}, snapshot_);
  const double in_view = SectorFieldOfView(point.RangeBearing(), point.CovRangeBearing(), sensor);
  return std::log1p(-sensor.detection_probability * in_view);
}

HypothesisBank::GatedMode HypothesisBank::Predict(const Leaf& leaf,
                                                  const Observation& observation,
                                                  const Eigen::Matrix2d& cov_z,
                                                  ModeRef mode) const {
  GatedMode gated;
  gated.state = mode.state;
  gated.prediction = leaf.filter.PredictObservation(observation, cov_z, mode, snapshot_);
  gated.log_likelihood =
      LogDetection(leaf, mode) + leaf.filter.LogLikelihood(gated.prediction, mode, snapshot_);
  return gated;
}

double HypothesisBank::LogDetection(const Leaf& leaf, ModeRef mode) const {
  const SensorCalibration& sensor = snapshot_.calibration().sensor;
  const KnownMapFilter::Point point = leaf.filter.PredictPoint(mode, snapshot_);
  // What is seen is in view, T-IV VI-D, whatever the model of the field of view says.
  const double in_view = std::max(
      SectorFieldOfView(point.RangeBearing(), point.CovRangeBearing(), sensor), options_.fov_leave);
  return std::log(sensor.detection_probability * in_view);
}

double HypothesisBank::LogUngated(const Leaf& leaf,
                                  const Observation& observation,
                                  const Eigen::Matrix2d& cov_z,
                                  ModeRef mode,
                                  GroupBelief* belief) const {
  const SensorCalibration& sensor = snapshot_.calibration().sensor;
  const double log_miss = LogMiss(leaf, mode.group, mode.state);
  double log_clutter = ClutterOf(observation, sensor).log_false_alarm;
  AddMiss(mode.state, log_miss, belief, &log_clutter);
  const Eigen::Matrix2d cov_misjudged = cov_z * (kMisjudgedSigmas * kMisjudgedSigmas);
  const auto prediction =
      leaf.filter.PredictObservation(observation, cov_misjudged, mode, snapshot_);
  const double log_misjudged =
      std::log(kMisjudgedShare) + LogDetection(leaf, mode) + prediction.LogLikelihood();
  return LogAdd(log_clutter, log_misjudged);
}

ObservationOutcome HypothesisBank::Judge(const Observation& observation, int group) const {
  const Eigen::Matrix2d cov_z = ObservationNoise(observation, snapshot_.calibration().sensor);
  const GroupBelief& belief = best().beliefs[BeliefIndex(group)];
  ObservationOutcome outcome;
  outcome.group = group;
  double best_score = kLogZero;
  for (int state = 1; state < belief.log_p.size(); ++state) {
    const GatedMode seen = Predict(best(), observation, cov_z, {group, state});
    if (seen.prediction.nis > gate_) continue;
    outcome.gated_any = true;
    const double score = belief.LogProbability(state) + seen.log_likelihood;
    if (score <= best_score) continue;
    best_score = score;
    outcome.gated = true;
    outcome.nis = seen.prediction.nis;
  }
  return outcome;
}

double HypothesisBank::ViewWeight(Visit* visit) const {
  const Se2& T_map_vehicle = best().filter.T_map_vehicle();
  if (visit->T_map_viewpoint) {
    const Se2 moved = visit->T_map_viewpoint->Inverse() * T_map_vehicle;
    const bool same_view =
        moved.translation().norm() < kSameViewDistance && std::abs(moved.yaw()) < kSameViewYaw;
    if (same_view) return kRepetitionWeight;
  }
  visit->T_map_viewpoint = T_map_vehicle;
  return 1.0;
}

void HypothesisBank::Observe(const Observation& observation, int group, double weight) {
  const std::size_t index = BeliefIndex(group);
  std::vector<Leaf> next;
  for (const Leaf& leaf : leaves_) Branch(leaf, observation, weight, index, &next);
  leaves_ = std::move(next);
}

void HypothesisBank::Branch(const Leaf& leaf,
                            const Observation& observation,
                            double weight,
                            std::size_t belief_index,
                            std::vector<Leaf>* next) const {
  const SensorCalibration& sensor = snapshot_.calibration().sensor;
  const Eigen::Matrix2d cov_z = ObservationNoise(observation, sensor);
  const ClutterDensity clutter = ClutterOf(observation, sensor);
  const int group = leaf.beliefs[belief_index].group;
  const auto add_seen = [&](const GatedMode& gated) {
    Leaf& child = next->emplace_back(leaf);
    GroupBelief& belief = child.beliefs[belief_index];
    child.log_weight += belief.LogProbability(gated.state) + weight * gated.log_likelihood;
    child.filter.Update(gated.prediction, {group, gated.state}, snapshot_, weight);
    belief.resolved = gated.state;
    belief.log_missed[gated.state] = 0.0;
  };

  // The rest: the observation is no known mode, and the filter stays as it is.
  Leaf rest = leaf;
  GroupBelief& belief = rest.beliefs[belief_index];
  const bool unresolved = belief.resolved == GroupBelief::kUnresolved;
  for (int state = 1; state < belief.log_p.size(); ++state) {
    if (leaf.beliefs[belief_index].LogProbability(state) == kLogZero) continue;
    const GatedMode seen = Predict(leaf, observation, cov_z, {group, state});
    const double log_ungated = LogUngated(leaf, observation, cov_z, {group, state}, &belief);
    if (unresolved) {
      if (seen.prediction.nis < kMaxForkNis) add_seen(seen);
      belief.log_p[state] += weight * log_ungated;
    } else if (seen.log_likelihood >= log_ungated) {
      // A resolved leaf takes an observation for what it likelier is; for others it may be either.
      add_seen(seen);
      return;
    } else {
      rest.log_weight += weight * log_ungated;
    }
  }
  if (!unresolved) {
    if (belief.resolved == 0) rest.log_weight += weight * clutter.log_any;
  } else {
    belief.log_p[0] += weight * clutter.log_any;
    const double total = LogSumExp(belief.log_p);
    rest.log_weight += total;
    if (total != kLogZero) belief.log_p.array() -= total;
  }
  if (rest.log_weight != kLogZero) next->push_back(std::move(rest));
}

void HypothesisBank::Miss(int group) {
  const std::size_t index = BeliefIndex(group);
  for (Leaf& leaf : leaves_) {
    GroupBelief& belief = leaf.beliefs[index];
    const bool unresolved = belief.resolved == GroupBelief::kUnresolved;
    for (int state = 1; state < belief.log_p.size(); ++state) {
      if (belief.LogProbability(state) == kLogZero) continue;
      AddMiss(state,
              LogMiss(leaf, group, state),
              &belief,
              unresolved ? &belief.log_p[state] : &leaf.log_weight);
    }
    if (!unresolved) continue;
    const double total = LogSumExp(belief.log_p);
    leaf.log_weight += total;
    belief.log_p.array() -= total;
  }
}

void HypothesisBank::AddMiss(int state,
                             double log_miss,
                             GroupBelief* belief,
                             double* log_likelihood) const {
  const double occluded = snapshot_.calibration().sensor.occluded_visit_probability;
  double& run = belief->log_missed[state];
  *log_likelihood += LogMissedRun(run + log_miss, occluded) - LogMissedRun(run, occluded);
  run += log_miss;
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
//
// How observations and misses weigh the leaves, T-IV (20) and (22-24).
#include <algorithm>
#include <cmath>

#include "localizer/hypothesis/body_prior.h"
#include "localizer/hypothesis/hypothesis_bank.h"
#include "localizer/models/detection_model.h"
#include "localizer/models/observation_model.h"

namespace shiftmap {
namespace {

// A detector now and then misjudges what it does see: this share of the detections of a landmark
// has errors of that many standard deviations (MRCLAM: 0.2 to 4.5 % are beyond 5). Without this
// tail a few outlier ranges prove a landmark gone, or at another mode near by.
constexpr double kOutlierShare = 0.03;
constexpr double kOutlierSigmas = 6.0;

// A mode whose innovation is farther out starts no leaf: it would weigh e⁻²⁰ of others. [-]
constexpr double kMaxForkNis = 40.0;

// A fork that weighs this much less than another leaf would be dropped at once. [nat]
constexpr double kNegligible = 25.0;

// Errors of consecutive observations from one place are alike (the same outlier edge of the same
// image): a repetition weighs a quarter, as if its likelihood were raised to that power.
constexpr double kRepetitionWeight = 0.25;
constexpr double kSameViewDistance = 0.1;  // [m]
constexpr double kSameViewYaw = 0.05;      // [rad]

// A landmark stands at an unknown place for certain if it is elsewhere with less probability.
constexpr double kCertain = 1e-3;

// One that is less likely to have moved says nothing of others.
constexpr double kMinMoved = 0.05;

}  // namespace

struct HypothesisBank::SeenObservation {
  SeenObservation(const Observation& observation,
                  int seen_group,
                  std::size_t belief,
                  const SensorCalibration& sensor,
                  double unknown_place_density)
      : group(seen_group), belief_index(belief) {
    const Eigen::Matrix2d cov_z = ObservationNoise(observation, sensor);
    constexpr double kOutlierVariance = kOutlierSigmas * kOutlierSigmas;
    measurement = KnownMapFilter::Measure(observation, cov_z);
    outlier = KnownMapFilter::Measure(observation, cov_z * kOutlierVariance);
    const double unit = SquareMetresPerUnit(observation);
    const double any = sensor.clutter_density_per_m2 + unknown_place_density;
    log_false_alarm = std::log(sensor.clutter_density_per_m2 * unit);
    log_any = std::log(any * unit);
    new_share = unknown_place_density / any;
  }

  int group;
  std::size_t belief_index;  // Into Leaf::beliefs.
  KnownMapFilter::Measurement measurement;
  KnownMapFilter::Measurement outlier;  // With the errors of the detector's tail.

  // Log-densities, in the observation's own units, of causes other than a known mode.
  double log_false_alarm;  // β_FA
  double log_any;          // β_FA + β_NT: `absent` leaves both open.
  double new_share;        // β_NT / (β_FA + β_NT).

  bool decided_absent = false;  // By the visit before this.
};

void HypothesisBank::Take(const Observation& observation, std::size_t index, int group) {
  AllowForSlip(group);
  SeenObservation seen(observation,
                       group,
                       tree_.BeliefIndex(group),
                       snapshot_.calibration().sensor,
                       unknown_place_density_);
  ObservationOutcome outcome = Judge(seen);
  outcome.index = index;
  events_.outcomes.push_back(outcome);

  Visit* visit = tree_.FindVisit(group);
  if (visit->decided) {
    const bool agrees = *visit->decided == 0 ? !outcome.gated_any : outcome.gated;
    if (visit->IsOverturnedBy(agrees)) {
      const auto at = static_cast<std::size_t>(visit - tree_.visits().data());
      events_.evidence.push_back(tree_.CloseVisit(at, snapshot_.groups()));
      tree_.OpenVisit(group, snapshot_.groups(), stamp_);
      visit = tree_.FindVisit(group);
    }
  }
  JudgePose(outcome, visit);
  visit->explained = outcome.gated_any;
  visit->end = stamp_;
  visit->seen = true;
  ++visit->observations;
  seen.decided_absent = visit->decided == 0;
  const double weight = ViewWeight(visit);
  if (weight == 1.0) view_.Saw(observation.PositionInVehicle());
  Observe(seen, weight);
  tree_.Reduce();
}

// What is seen is in view, T-IV VI-D.
double HypothesisBank::LogDetection(double in_view) const {
  return std::log(snapshot_.calibration().sensor.detection_probability *
                  std::max(in_view, options_.fov_leave));
}

HypothesisBank::ModeScore HypothesisBank::Score(const Leaf& leaf,
                                                const SeenObservation& seen,
                                                int state) const {
  const double detection = snapshot_.calibration().sensor.detection_probability;
  const KnownMapFilter::Point point = leaf.filter.PredictPoint({seen.group, state}, snapshot_);
  const InViewProbability in_view = InView(point);
  ModeScore score;
  score.prediction = leaf.filter.PredictObservation(seen.measurement, point);
  score.log_detection = LogDetection(in_view.sensor);
  score.log_miss = std::log1p(-detection * in_view.own);
  return score;
}

double HypothesisBank::LogLikelihood(const Leaf& leaf, ModeRef mode, ModeScore* score) const {
  if (!score->log_likelihood) {
    score->log_likelihood =
        score->log_detection + leaf.filter.LogLikelihood(score->prediction, mode, snapshot_);
  }
  return *score->log_likelihood;
}

double HypothesisBank::TakeAsUngated(const Leaf& leaf,
                                     const SeenObservation& seen,
                                     const ModeScore& score,
                                     int state,
                                     PlaceBelief* belief) const {
  double log_clutter = seen.log_false_alarm;
  AddMiss(state, score.log_miss, Occluded(), belief, &log_clutter);
  const auto prediction = leaf.filter.PredictObservation(seen.outlier, score.prediction.point);
  const double log_outlier =
      std::log(kOutlierShare) + score.log_detection + prediction.LogLikelihood();
  return LogAdd(log_clutter, log_outlier);
}

// Under `absent` an observation is clutter or a new place, or the landmark at the place where it
// was seen before. Of places one is kept, the likeliest.
double HypothesisBank::TakeAsAbsent(const SeenObservation& seen,
                                    double weight,
                                    Leaf* leaf,
                                    PlaceBelief* belief) const {
  const UnknownPlace* const place =
      belief->place_probability > 0.0 ? leaf->filter.FindPlace(seen.group) : nullptr;
  if (!place) {
    const AtNoMode first = ScoreAtNoMode(seen, *leaf, *belief);
    StartPlace(seen, first.place_share, leaf, belief);
    return weight * first.log_density;
  }
  const double detection = snapshot_.calibration().sensor.detection_probability;
  const KnownMapFilter::Prediction prediction = leaf->filter.PredictPlace(*place, seen.measurement);
  const InViewProbability in_view = InView(prediction.point);
  const double log_here = LogAtPlace(prediction, *place, *leaf);
  double log_clutter = seen.log_any;
  AddMiss(0, std::log1p(-detection * in_view.own), Occluded(), belief, &log_clutter);
  const double log_outlier = std::log(kOutlierShare) + LogDetection(in_view.sensor) +
                             leaf->filter.PredictPlace(*place, seen.outlier).LogLikelihood();
  const double log_not_here = LogAdd(log_clutter, log_outlier);
  const bool here = log_here > log_not_here;
  // As a leaf that is resolved: it takes an observation for what it likelier is.
  const double log_at_place =
      std::log(belief->place_probability) + weight * std::max(log_here, log_not_here);
  const AtNoMode elsewhere =
      here ? AtNoMode{seen.log_any, seen.new_share} : ScoreAtNoMode(seen, *leaf, *belief);
  const double log_other = std::log1p(-belief->place_probability) + weight * elsewhere.log_density;
  const double total = LogAdd(log_at_place, log_other);
  const double at_place = std::exp(log_at_place - total);
  const double started = std::exp(log_other - total) * elsewhere.place_share;
  if (started > at_place) {
    StartPlace(seen, started, leaf, belief);
    return total;
  }
  belief->place_probability = at_place;
  if (here) {
    const double doubt = 1.0 - at_place * std::exp(belief->LogProbability(0));
    // One that is not decided for, alone or from one view, may be a pose that is off or an outlier.
    const bool body = MovedIn(*leaf).size() > 1 && IsSeenFromApart(*place);
    const bool certain = doubt < kCertain && (seen.decided_absent || body);
    leaf->filter.UpdatePlace(*place, prediction, snapshot_, weight, certain);
    belief->log_missed[0] = 0.0;
    const UnknownPlace* const corrected = leaf->filter.FindPlace(seen.group);
    if (!corrected || !IsUnknown(seen.group, corrected->p_map_landmark))
      belief->place_probability = 0.0;
  }
  return total;
}

// One outlier view repeats itself until the landmark is seen from apart, whatever the mode: so what
// it says once for `absent` it does not say again with each scan. A leaf that is resolved remembers
// where it was.
double HypothesisBank::TakeAsSameView(const SeenObservation& seen,
                                      double log_ungated,
                                      Leaf* leaf) const {
  const UnknownPlace* const place = leaf->filter.FindPlace(seen.group);
  if (place && IsSeenFromApart(*place)) return log_ungated;
  if (place) {
    const auto prediction = leaf->filter.PredictPlace(*place, seen.measurement);
    const double log_same = LogAtPlace(prediction, *place, *leaf);
    if (log_same > log_ungated) return log_same;
  }
  leaf->filter.StartPlace(seen.group, seen.measurement, T_odom_vehicle_.translation());
  return log_ungated;
}

double HypothesisBank::LogAtPlace(const KnownMapFilter::Prediction& prediction,
                                  const UnknownPlace& place,
                                  const Leaf& leaf) const {
  return LogDetection(InView(prediction.point).sensor) +
         leaf.filter.LogLikelihood(prediction, place, snapshot_);
}

// A landmark seen near a mode does not count as moved.
HypothesisBank::AtNoMode HypothesisBank::ScoreAtNoMode(const SeenObservation& seen,
                                                       const Leaf& leaf,
                                                       const PlaceBelief& belief) const {
  AtNoMode score{seen.log_any, seen.new_share};
  const MovedLandmarks moved = MovedIn(leaf);
  if (moved.empty()) return score;
  const KnownMapFilter::Measurement measurement = leaf.filter.WithoutScale(seen.measurement);
  if (!IsUnknown(seen.group, leaf.filter.T_map_vehicle() * measurement.q)) return score;
  const double with_others =
      snapshot_.calibration().sensor.detection_probability *
      DensityWithOthers(snapshot_, leaf.filter, seen.group, seen.measurement, moved);
  // That others moved makes `absent` likelier than its prior, by which this is divided.
  const double log_with_others =
      std::log(with_others) - belief.LogProbability(0) + measurement.log_m2_per_unit;
  score.log_density = LogAdd(seen.log_any, log_with_others);
  score.place_share = 1.0 - (1.0 - seen.new_share) * std::exp(seen.log_any - score.log_density);
  return score;
}

MovedLandmarks HypothesisBank::MovedIn(const Leaf& leaf) const {
  MovedLandmarks moved;
  for (const PlaceBelief& belief : leaf.beliefs) {
    const double probability = std::exp(belief.LogProbability(0)) * belief.place_probability;
    if (probability < kMinMoved) continue;
    const UnknownPlace* const place = leaf.filter.FindPlace(belief.group);
    if (place) moved.push_back({place, probability});
  }
  return moved;
}

void HypothesisBank::StartPlace(const SeenObservation& seen,
                                double probability,
                                Leaf* leaf,
                                PlaceBelief* belief) const {
  leaf->filter.StartPlace(seen.group, seen.measurement, T_odom_vehicle_.translation());
  const UnknownPlace& place = *leaf->filter.FindPlace(seen.group);
  belief->place_probability = IsUnknown(seen.group, place.p_map_landmark) ? probability : 0.0;
  belief->log_missed[0] = 0.0;
}

bool HypothesisBank::IsUnknown(int group, const Eigen::Vector2d& p_map_landmark) const {
  const std::vector<Mode>& modes = GroupAt(group).modes;
  return std::all_of(modes.begin(), modes.end(), [&](const Mode& mode) {
    return (mode.p_map_landmark - p_map_landmark).norm() >= kMinDisplacement;
  });
}

// No miss raises a likelihood, and outlier positions scatter more widely than others.
double HypothesisBank::LogUngatedAtMost(const SeenObservation& seen, const ModeScore& score) {
  return LogAdd(seen.log_false_alarm,
                std::log(kOutlierShare) + score.log_detection + score.prediction.LogPeak());
}

ObservationOutcome HypothesisBank::Judge(const SeenObservation& seen) {
  const PlaceBelief& belief = best().beliefs[seen.belief_index];
  ObservationOutcome outcome;
  outcome.group = seen.group;
  double best_score = kLogZero;
  judged_.assign(belief.log_p.size(), std::nullopt);
  for (int state = 1; state < belief.states(); ++state) {
    const double log_p = belief.LogProbability(state);
    if (log_p == kLogZero) continue;
    ModeScore& mode = judged_[static_cast<std::size_t>(state)].emplace(Score(best(), seen, state));
    if (mode.prediction.nis > gate_) continue;
    const double score = log_p + LogLikelihood(best(), {seen.group, state}, &mode);
    if (score <= best_score) continue;
    best_score = score;
    outcome.gated = true;
    outcome.state = state;
    outcome.nu = mode.prediction.nu;
    outcome.S = mode.prediction.S;
    outcome.nis = mode.prediction.nis;
  }
  outcome.gated_any = outcome.gated;
  for (int state = 1; state < belief.states() && !outcome.gated_any; ++state) {
    if (belief.LogProbability(state) != kLogZero) continue;
    outcome.gated_any = Score(best(), seen, state).prediction.nis <= gate_;
  }
  return outcome;
}

double HypothesisBank::ViewWeight(Visit* visit) const {
  if (visit->T_odom_viewpoint) {
    const Se2 moved = visit->T_odom_viewpoint->Inverse() * T_odom_vehicle_;
    const bool same_view =
        moved.translation().norm() < kSameViewDistance && std::abs(moved.yaw()) < kSameViewYaw;
    if (same_view) return kRepetitionWeight;
  }
  visit->T_odom_viewpoint = T_odom_vehicle_;
  return 1.0;
}

void HypothesisBank::Observe(const SeenObservation& seen, double weight) {
  bool heaviest = true;
  heaviest_fork_ = kLogZero;
  for (Leaf* leaf : tree_.leaves().Rebuild()) {
    Branch(seen, weight, heaviest, leaf);
    heaviest = false;
  }
}

void HypothesisBank::AddChild(const Leaf& parent,
                              const SeenObservation& seen,
                              const ModeScore& score,
                              const PlaceBelief& before,
                              int state,
                              double weight) {
  const double log_weight =
      parent.log_weight + before.LogProbability(state) + weight * *score.log_likelihood;
  if (log_weight < heaviest_fork_ - kNegligible) return;
  heaviest_fork_ = std::max(heaviest_fork_, log_weight);
  Leaf& child = tree_.leaves().Add(parent);
  child.beliefs[seen.belief_index] = before;
  Resolve(seen, score, state, weight, &child);
}

void HypothesisBank::Resolve(const SeenObservation& seen,
                             const ModeScore& score,
                             int state,
                             double weight,
                             Leaf* leaf) const {
  PlaceBelief& belief = leaf->beliefs[seen.belief_index];
  leaf->log_weight += belief.LogProbability(state) + weight * *score.log_likelihood;
  leaf->filter.Update(score.prediction, {seen.group, state}, snapshot_, weight);
  leaf->filter.ErasePlace(seen.group);
  belief.resolved = state;
  belief.place_probability = 0.0;
  belief.log_missed[static_cast<std::size_t>(state)] = 0.0;
}

void HypothesisBank::Branch(const SeenObservation& seen, double weight, bool heaviest, Leaf* leaf) {
  // The leaf itself becomes the rest: the observation is no known mode, and the filter stays.
  PlaceBelief& belief = leaf->beliefs[seen.belief_index];
  const PlaceBelief before = belief;
  const bool unresolved = before.resolved == GroupBelief::kUnresolved;
  bool explained = false;
  StateValues log_ungated_by(before.log_p.size(), kLogZero);
  for (int state = 1; state < before.states(); ++state) {
    if (before.LogProbability(state) == kLogZero) continue;
    std::optional<ModeScore> own;
    std::optional<ModeScore>& known = heaviest ? judged_[static_cast<std::size_t>(state)] : own;
    if (!known) known = Score(*leaf, seen, state);
    ModeScore& score = *known;
    if (!unresolved &&
        LogLikelihood(*leaf, {seen.group, state}, &score) >= LogUngatedAtMost(seen, score)) {
      Resolve(seen, score, state, weight, leaf);
      tree_.leaves().Keep(leaf);
      return;
    }
    const double log_ungated = TakeAsUngated(*leaf, seen, score, state, &belief);
    explained = explained || score.prediction.nis <= gate_;
    if (unresolved) {
      if (score.prediction.nis < kMaxForkNis) {
        LogLikelihood(*leaf, {seen.group, state}, &score);
        AddChild(*leaf, seen, score, before, state, weight);
      }
      log_ungated_by[static_cast<std::size_t>(state)] = weight * log_ungated;
    } else if (LogLikelihood(*leaf, {seen.group, state}, &score) >= log_ungated) {
      // A resolved leaf takes an observation for what it likelier is; for others it may be either.
      belief = before;
      Resolve(seen, score, state, weight, leaf);
      tree_.leaves().Keep(leaf);
      return;
    } else {
      leaf->log_weight += weight * TakeAsSameView(seen, log_ungated, leaf);
    }
  }
  if (!unresolved) {
    if (belief.resolved == 0) leaf->log_weight += weight * seen.log_any;
  } else {
    double log_same_view = kLogZero;
    if (belief.log_p[0] != kLogZero) {
      const UnknownPlace* const place =
          belief.place_probability > 0.0 ? leaf->filter.FindPlace(seen.group) : nullptr;
      const bool same_view = place && !explained && !IsSeenFromApart(*place);
      const double log_absent = TakeAsAbsent(seen, weight, leaf, &belief);
      belief.log_p[0] += log_absent;
      if (same_view) log_same_view = log_absent;
    }
    for (std::size_t state = 1; state < belief.log_p.size(); ++state) {
      belief.log_p[state] += std::max(log_ungated_by[state], log_same_view);
    }
    leaf->log_weight += Normalize(&belief);
  }
  if (leaf->log_weight == kLogZero) {
    tree_.leaves().Drop(leaf);
  } else {
    tree_.leaves().Keep(leaf);
  }
}

void HypothesisBank::Miss(int group) {
  const std::size_t index = tree_.BeliefIndex(group);
  for (Leaf* leaf : tree_.leaves().all()) {
    PlaceBelief& belief = leaf->beliefs[index];
    const auto in_view = [&](int state) {
      return InView(leaf->filter.PredictPoint({group, state}, snapshot_)).own;
    };
    MissModes(snapshot_.calibration().sensor, in_view, &belief, &leaf->log_weight);
    if (belief.resolved != GroupBelief::kUnresolved) continue;
    MissPlace(*leaf, &belief);
    leaf->log_weight += Normalize(&belief);
  }
}

void HypothesisBank::MissPlace(const Leaf& leaf, PlaceBelief* belief) const {
  if (belief->place_probability == 0.0 || belief->log_p[0] == kLogZero) return;
  const UnknownPlace* const place = leaf.filter.FindPlace(belief->group);
  if (!place) return;
  const double detection = snapshot_.calibration().sensor.detection_probability;
  const double in_view = InView(leaf.filter.PredictPlace(*place)).own;
  if (in_view == 0.0) return;
  double log_here = std::log(belief->place_probability);
  AddMiss(0, std::log1p(-detection * in_view), Occluded(), belief, &log_here);
  const double total = LogAdd(log_here, std::log1p(-belief->place_probability));
  belief->log_p[0] += total;
  belief->place_probability = std::exp(log_here - total);
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
//
// How observations weigh and fork the leaves, T-IV (20) and V-B.
#include <algorithm>
#include <cmath>
#include <limits>

#include "localizer/models/observation_model.h"
#include "mapper/tree/tree_slam.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// A mode whose innovation is farther out corrects no leaf, whatever the options: its score is e⁻²⁰⁰
// of others. [-]
constexpr double kMaxUngatedNis = 400.0;

}  // namespace

// νᵀ S⁻¹ ν; infinite for a mode that is not around the vehicle. Costs less than a score.
double TreeSlam::NisOf(const SlamLeaf& leaf, const Seen& seen, int state) const {
  const SlamState& slam = leaf.filter.state();
  const int landmark = leaf.filter.mode(seen.group, state).landmark;
  if (landmark == SlamMap::kNoLandmark || !slam.IsActive(landmark)) {
    return std::numeric_limits<double>::infinity();
  }
  Eigen::Matrix2d S;
  const Innovation innovation = slam.Linearized({landmark, seen.observation}, &S);
  return SquaredMahalanobis(innovation.nu, S);
}

TreeSlam::Score TreeSlam::ScoreMode(const SlamLeaf& leaf, const Seen& seen, int state) const {
  const SlamState& slam = leaf.filter.state();
  const int landmark = leaf.filter.mode(seen.group, state).landmark;
  if (landmark == SlamMap::kNoLandmark || !slam.IsActive(landmark)) {
    return {std::numeric_limits<double>::infinity(), kLogZero, 0.0};
  }
  Eigen::Matrix2d S;
  const Innovation innovation = slam.Linearized({landmark, seen.observation}, &S);
  const double in_view = InView(slam.RelativeTo(landmark));
  const double detection = sensor_.detection_probability;
  Score score;
  score.nis = SquaredMahalanobis(innovation.nu, S);
  // What is seen is in view, T-IV VI-D.
  score.log_likelihood =
      std::log(detection * std::max(in_view, options_.fov_leave)) + LogGaussian(innovation.nu, S);
  score.log_miss = std::log1p(-detection * in_view);
  return score;
}

bool TreeSlam::CanFindMode(const GroupBelief& belief) const {
  if (belief.resolved != GroupBelief::kUnresolved) {
    return options_.insertion == NewModeInsertion::kChild;
  }
  return belief.log_p[0] != kLogZero;
}

bool TreeSlam::GatesNowhere(const SlamLeaf& leaf, const Seen& seen) const {
  const int modes = static_cast<int>(groups_[static_cast<std::size_t>(seen.group)].modes.size());
  for (int state = 1; state <= modes; ++state) {
    if (NisOf(leaf, seen, state) <= gate_) return false;
  }
  return true;
}

void TreeSlam::Branch(const Seen& seen, SlamLeaf* leaf) {
  if (leaf->beliefs[seen.belief].resolved == GroupBelief::kUnresolved) {
    BranchUnresolved(seen, leaf);
  } else {
    BranchResolved(seen, leaf);
  }
  if (leaf->log_weight == kLogZero) {
    tree_.leaves().Drop(leaf);
  } else {
    tree_.leaves().Keep(leaf);
  }
}

// The leaf itself becomes the rest: the observation is no known mode, and the filter stays.
void TreeSlam::BranchUnresolved(const Seen& seen, SlamLeaf* leaf) {
  GroupBelief& belief = leaf->beliefs[seen.belief];
  const GroupBelief before = belief;
  bool gated = false;
  for (int state = 1; state < before.states(); ++state) {
    if (state == seen.new_state) continue;
    const Score score = ScoreMode(*leaf, seen, state);
    gated = gated || score.nis <= gate_;
    if (before.LogProbability(state) == kLogZero) continue;
    double& log_p = belief.log_p[static_cast<std::size_t>(state)];
    if (leaf->filter.mode(seen.group, state).landmark == SlamMap::kNoLandmark) {
      log_p += LogAdd(seen.log_false_alarm, seen.log_new);  // Unknown here, as with `absent`.
      continue;
    }
    if (UpdatesBy(score)) AddChild(*leaf, before, seen, state, score.log_likelihood);
    log_p += seen.log_false_alarm;
    AddMiss(state, score.log_miss, sensor_.occluded_visit_probability, &belief, &log_p);
  }
  if (before.log_p[0] != kLogZero) {
    if (!gated && seen.new_state > 0) {
      FindMode(seen, before.log_p[0], leaf);
    } else {
      belief.log_p[0] += LogAdd(seen.log_false_alarm, seen.log_new);
    }
  }
  leaf->log_weight += Normalize(&belief);
}

void TreeSlam::BranchResolved(const Seen& seen, SlamLeaf* leaf) {
  GroupBelief& belief = leaf->beliefs[seen.belief];
  const int state = belief.resolved;
  const Score score = ScoreMode(*leaf, seen, state);
  const double log_clutter = seen.log_false_alarm + score.log_miss;
  if (score.nis <= gate_ && score.log_likelihood >= log_clutter) {
    Resolve(seen, state, score.log_likelihood, leaf);
    return;
  }
  const GroupBelief before = belief;
  if (UpdatesBy(score)) AddChild(*leaf, before, seen, state, score.log_likelihood);
  const bool finds = options_.insertion == NewModeInsertion::kChild && seen.new_state > 0 &&
                     GatesNowhere(*leaf, seen);
  if (!finds) {
    leaf->log_weight += seen.log_false_alarm;
    AddMiss(state, score.log_miss, sensor_.occluded_visit_probability, &belief, &leaf->log_weight);
    return;
  }
  belief.resolved = GroupBelief::kUnresolved;
  AsVector(belief.log_p).setConstant(kLogZero);
  belief.log_p[static_cast<std::size_t>(state)] = log_clutter;
  FindMode(seen, 0.0, leaf);
  belief.log_p[0] = kLogZero;
  leaf->log_weight += Normalize(&belief);
}

// @param log_likelihood  Of the observation, if the mode holds.
void TreeSlam::AddChild(const SlamLeaf& parent,
                        const GroupBelief& before,
                        const Seen& seen,
                        int state,
                        double log_likelihood) {
  SlamLeaf& child = tree_.leaves().Add(parent);
  child.beliefs[seen.belief] = before;
  Resolve(seen, state, before.LogProbability(state) + log_likelihood, &child);
}

void TreeSlam::Resolve(const Seen& seen, int state, double log_weight, SlamLeaf* leaf) {
  GroupBelief& belief = leaf->beliefs[seen.belief];
  SlamMap::ModeLandmark& mode = leaf->filter.mode(seen.group, state);
  const SlamPair pair{mode.landmark, seen.observation};
  leaf->filter.state().Update({&pair, 1});
  ++mode.sightings;
  leaf->log_weight += log_weight;
  belief.resolved = state;
  belief.log_missed[static_cast<std::size_t>(state)] = 0.0;
}

// The pose learns nothing from a landmark at a place of its own, so that the leaf need not fork.
void TreeSlam::FindMode(const Seen& seen, double log_prior, SlamLeaf* leaf) const {
  leaf->filter.mode(seen.group, seen.new_state) = {leaf->filter.state().Add(*seen.observation), 1};
  GroupBelief& belief = leaf->beliefs[seen.belief];
  double& log_found = belief.log_p[static_cast<std::size_t>(seen.new_state)];
  if (options_.transform_alternative) {
    log_found = log_prior + LogAdd(seen.log_false_alarm, seen.log_new);
    belief.log_p[0] = kLogZero;
  } else {
    log_found = log_prior + seen.log_new;
    belief.log_p[0] = log_prior + seen.log_false_alarm;
  }
}

bool TreeSlam::UpdatesBy(const Score& score) const {
  return score.nis <= gate_ || (options_.update_ungated && score.nis <= kMaxUngatedNis);
}

void TreeSlam::Miss(int group) {
  const std::size_t index = tree_.BeliefIndex(group);
  for (SlamLeaf* leaf : tree_.leaves().all()) {
    GroupBelief& belief = leaf->beliefs[index];
    const auto in_view = [&](int state) {
      return InView(leaf->filter, leaf->filter.mode(group, state).landmark);
    };
    MissModes(sensor_, in_view, &belief, &leaf->log_weight);
    if (belief.resolved == GroupBelief::kUnresolved) leaf->log_weight += Normalize(&belief);
  }
}

}  // namespace shiftmap

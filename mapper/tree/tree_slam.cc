// SPDX-License-Identifier: Apache-2.0
//
// The life of groups, modes and visits. How observations weigh and fork leaves: tree_branching.cc.
#include "mapper/tree/tree_slam.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// No landmark without signature is known better, which keeps its covariance positive. [m]
constexpr double kLeastSd = 1e-3;

MotionIncrement Scaled(const MotionIncrement& motion, const Eigen::Vector2d& log_scale) {
  MotionIncrement scaled = motion;
  const Eigen::Vector3d step = motion.J_calibration.leftCols<2>() * log_scale;
  scaled.T_begin_end = motion.T_begin_end * Se2::Exp(step);
  return scaled;
}

std::vector<LandmarkGroup> GroupsOf(const std::optional<MapContent>& prior) {
  return prior ? prior->groups : std::vector<LandmarkGroup>();
}

}  // namespace

TreeSlam::TreeSlam(const TreeSlamOptions& options,
                   const Calibration& calibration,
                   const std::optional<MapContent>& prior)
    : options_(options),
      sensor_(calibration.sensor),
      view_(calibration.sensor),
      gate_(ChiSquareQuantile(options.gate_probability, 2)),
      tree_({options.alpha, options.max_leaves, options.visit_gap_s},
            GroupsOf(prior),
            prior ? prior->stamp : Stamp()),
      groups_(GroupsOf(prior)) {
  SlamMap map(calibration, options.errors, options.merging);
  if (prior) AddPrior(*prior, &map);
  tree_.Restart({std::move(map)});
}

void TreeSlam::AddPrior(const MapContent& prior, SlamMap* map) {
  std::vector<Eigen::Vector2d> positions;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const int group = static_cast<int>(g);
    index_[groups_[g].signature] = group;
    chains_.push_back(groups_[g].chain);
    confirmed_modes_.push_back(static_cast<int>(groups_[g].modes.size()));
    map->AddGroup();
    for (const Mode& mode : groups_[g].modes) {
      map->AddMode(group);
      positions.push_back(mode.p_map_landmark);
    }
  }
  int landmark = map->state().AddKnown(positions, prior.covariance.Dense());
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    for (std::size_t k = 0; k < groups_[g].modes.size(); ++k) {
      map->mode(static_cast<int>(g), static_cast<int>(k) + 1) = {landmark++,
                                                                 options_.min_sightings};
    }
  }
  AddAnonymous(prior.anonymous_landmarks, map);
}

// What errors they share the map does not say: each is the sum of two of its covariance, one in
// common with the others and one its own.
void TreeSlam::AddAnonymous(const std::vector<Mode>& landmarks, SlamMap* map) const {
  std::vector<Eigen::Vector2d> positions;
  Eigen::MatrixXd roots(2 * landmarks.size(), 2);
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    positions.push_back(landmarks[i].p_map_landmark);
    roots.middleRows<2>(static_cast<Eigen::Index>(2 * i)) =
        landmarks[i].cov_p_map_landmark.llt().matrixL();
  }
  Eigen::MatrixXd cov = roots * roots.transpose();
  for (Eigen::Index i = 0; i < cov.rows(); i += 2) cov.block<2, 2>(i, i) *= 2.0;
  int known = map->state().AddKnown(positions, cov);
  for (const Mode& mode : landmarks) {
    map->anonymous().push_back(
        {known++, options_.anonymous_landmarks.confirm_sightings, 0, mode.last_seen});
  }
}

void TreeSlam::BeginRun(const PoseWithCovariance& start,
                        const Calibration& calibration,
                        Stamp stamp,
                        Direction direction) {
  stamp_ = now_ = begin_ = stamp;
  backward_ = direction == Direction::kBackward;
  Calibration of_run = calibration;
  sensor_.sd_range_m = calibration.sensor.sd_range_m;
  sensor_.sd_bearing_rad = calibration.sensor.sd_bearing_rad;
  sensor_.sd_position_m = calibration.sensor.sd_position_m;
  of_run.sensor = sensor_;
  for (SlamLeaf* leaf : tree_.leaves().all()) leaf->filter.state().StartFrom(start, of_run);
}

void TreeSlam::BeginRunOnMap(const PoseWithCovariance& start,
                             const Calibration& calibration,
                             Stamp stamp,
                             Direction direction) {
  BeginRun(start, calibration, stamp, direction);
  for (SlamLeaf* leaf : tree_.leaves().all()) {
    SlamState& state = leaf->filter.state();
    state.Focus(sensor_.max_range_m);
    std::vector<int> near;
    for (const int landmark : state.active()) {
      const double range_m = (state.Position(landmark) - state.pose().translation()).norm();
      if (range_m <= sensor_.max_range_m) near.push_back(landmark);
    }
    state.TieStartTo(near);
  }
}

void TreeSlam::Predict(const MotionIncrement& motion) {
  for (SlamLeaf* leaf : tree_.leaves().all()) {
    SlamState& state = leaf->filter.state();
    state.Predict(Scaled(motion, state.log_scale()));
  }
}

void TreeSlam::PredictEuler(double v_mps,
                            double omega_radps,
                            double seconds,
                            const Eigen::Matrix3d& Q) {
  for (SlamLeaf* leaf : tree_.leaves().all()) {
    SlamState& state = leaf->filter.state();
    state.Predict(EulerStep(state.pose(), v_mps, omega_radps, seconds, Q));
  }
}

const TreeEvents& TreeSlam::Correct(const Scan& scan, const LidarView* lidar) {
  events_.evidence.clear();
  events_.decisions.clear();
  events_.ungated = 0;
  events_.nis_sum = 0.0;
  stamp_ = scan.stamp;
  now_ = backward_ ? begin_ + (begin_ - stamp_) : stamp_;
  ++scan_;
  view_.Look(lidar);
  tree_.CloseStaleVisits(now_,
                         [&](std::size_t visit) { events_.evidence.push_back(CloseVisit(visit)); });
  Scan corrected = scan;
  double reach_m = sensor_.max_range_m;
  for (Observation& observation : corrected.observations) {
    observation = Corrected(observation, sensor_);
    reach_m = std::max(reach_m, observation.PositionInVehicle().norm());
  }
  const UsableSightings usable = FindUsableSightings(corrected, options_.front_end);
  for (SlamLeaf* leaf : tree_.leaves().all()) {
    SlamState& state = leaf->filter.state();
    state.Focus(reach_m + PlaceSlack(state, reach_m));
  }
  OpenVisitsInView();
  for (const int i : usable.named) Take(corrected.observations[static_cast<std::size_t>(i)]);
  for (const Visit& visit : tree_.visits()) {
    if (!visit.seen) Miss(visit.group);
  }
  CountDetections(static_cast<int>(usable.named.size()));
  if (options_.anonymous) {
    for (SlamLeaf* leaf : tree_.leaves().all()) {
      leaf->log_weight += UpdateAnonymous(corrected,
                                          usable.anonymous,
                                          scan_,
                                          sensor_,
                                          options_.anonymous_landmarks,
                                          &leaf->filter.anonymous(),
                                          &leaf->filter.state());
    }
  }
  tree_.Reduce();
  tree_.Test(groups_, now_, &events_.decisions);
  tree_.ReleaseAgreedBeliefs();
  return events_;
}

std::vector<VisitEvidence> TreeSlam::EndRun() {
  std::vector<VisitEvidence> evidence;
  while (!tree_.visits().empty()) evidence.push_back(CloseVisit(0));
  return evidence;
}

void TreeSlam::ForgetAnonymous(const std::function<bool(const Eigen::Vector2d&)>& is_forgotten) {
  for (SlamLeaf* leaf : tree_.leaves().all()) {
    SlamState& state = leaf->filter.state();
    std::erase_if(leaf->filter.anonymous(), [&](const AnonymousLandmark& landmark) {
      const bool forgotten = is_forgotten(state.Position(landmark.landmark));
      if (forgotten) state.Remove(landmark.landmark);
      return forgotten;
    });
  }
}

int TreeSlam::GroupOf(const Signature& signature) {
  const auto [entry, added] = index_.try_emplace(signature, static_cast<int>(groups_.size()));
  if (added) {
    LandmarkGroup group;
    group.signature = signature;
    group.chain = ModeChain::Uniform(0, options_.leave_rate_per_s);
    chains_.push_back(group.chain);
    confirmed_modes_.push_back(0);
    tree_.AddGroup(group.probabilities, now_);
    groups_.push_back(std::move(group));
    for (SlamLeaf* leaf : tree_.leaves().all()) leaf->filter.AddGroup();
  }
  return entry->second;
}

double TreeSlam::InView(const SlamState::Relative& relative) const {
  constexpr double kFarSd = 6.0;  // Beyond it the probability of being in view is 1e-9.
  if (relative.q_vehicle.norm() > sensor_.max_range_m + kFarSd * std::sqrt(relative.cov.trace())) {
    return 0.0;
  }
  return view_.Probability(relative.q_vehicle, relative.cov).sensor;
}

double TreeSlam::InView(const SlamMap& map, int landmark) const {
  if (landmark == SlamMap::kNoLandmark || !map.state().IsActive(landmark)) return 0.0;
  return InView(map.state().RelativeTo(landmark));
}

bool TreeSlam::AnyInView(int group, double threshold) const {
  const int modes = static_cast<int>(groups_[static_cast<std::size_t>(group)].modes.size());
  for (int state = 1; state <= modes; ++state) {
    const SlamMap& map = best().filter;
    if (InView(map, map.mode(group, state).landmark) > threshold) return true;
  }
  return false;
}

void TreeSlam::OpenVisitsInView() {
  for (Visit& visit : tree_.visits()) {
    visit.seen = false;
    if (AnyInView(visit.group, options_.fov_leave)) visit.end = now_;
  }
  for (int group = 0; group < static_cast<int>(groups_.size()); ++group) {
    if (!tree_.FindVisit(group) && AnyInView(group, options_.fov_enter)) {
      tree_.OpenVisit(group, groups_, now_);
    }
  }
}

VisitEvidence TreeSlam::CloseVisit(std::size_t visit_index) {
  ReviseNewModes(tree_.visits()[visit_index].group);
  ShareModes(tree_.visits()[visit_index].group);
  VisitEvidence evidence = tree_.CloseVisit(visit_index, groups_);
  if (backward_) {
    const Stamp begin = begin_ - (evidence.end - begin_);
    evidence.end = begin_ - (evidence.begin - begin_);
    evidence.begin = begin;
  }
  return evidence;
}

void TreeSlam::Take(const Observation& observation) {
  const int group = GroupOf(observation.signature);
  if (!tree_.FindVisit(group)) tree_.OpenVisit(group, groups_, now_);
  const double unit = SquareMetresPerUnit(observation);
  Seen seen{&observation, group, 0, 0, 0.0, 0.0};
  seen.log_false_alarm = std::log(sensor_.clutter_density_per_m2 * unit);
  seen.log_new = std::log(sensor_.new_landmark_density_per_m2 * unit);
  CountContradictions(seen);
  seen.belief = tree_.BeliefIndex(group);
  Visit& visit = *tree_.FindVisit(group);
  visit.end = now_;
  visit.seen = true;
  ++visit.observations;
  CountOutcome(seen);
  const auto leaves = tree_.leaves().all();
  const bool found = std::any_of(leaves.begin(), leaves.end(), [&](const SlamLeaf* leaf) {
    return CanFindMode(leaf->beliefs[seen.belief]) && GatesNowhere(*leaf, seen);
  });
  if (found) seen.new_state = AddMode(group);
  for (SlamLeaf* leaf : tree_.leaves().Rebuild()) Branch(seen, leaf);
  tree_.Reduce();
  const int resolved = best().beliefs[seen.belief].resolved;
  if (resolved > 0) {
    groups_[static_cast<std::size_t>(group)]
        .modes[static_cast<std::size_t>(resolved) - 1]
        .last_seen = stamp_;
  }
}

void TreeSlam::CountOutcome(const Seen& seen) {
  if (GatesNowhere(best(), seen)) {
    ++events_.ungated;
    return;
  }
  const GroupBelief& belief = best().beliefs[seen.belief];
  if (belief.resolved <= 0) return;
  const double nis = NisOf(best(), seen, belief.resolved);
  if (nis <= gate_) events_.nis_sum += nis;
}

void TreeSlam::CountDetections(int seen) {
  constexpr double kWellInView = 0.9;  // P_FOV: a miss is then one of the detector.
  for (const Visit& visit : tree_.visits()) {
    if (seen - (visit.seen ? 1 : 0) == 0) continue;
    const int resolved = best().beliefs[tree_.BeliefIndex(visit.group)].resolved;
    if (resolved <= 0) continue;
    const SlamMap& map = best().filter;
    if (InView(map, map.mode(visit.group, resolved).landmark) < kWellInView) continue;
    detections_.expected += 1.0;
    detections_.detected += visit.seen ? 1.0 : 0.0;
  }
}

void TreeSlam::CountContradictions(const Seen& seen) {
  Visit* const visit = tree_.FindVisit(seen.group);
  if (!visit->decided) return;
  const bool agrees = *visit->decided == 0 ? GatesNowhere(best(), seen)
                                           : NisOf(best(), seen, *visit->decided) <= gate_;
  if (!visit->IsOverturnedBy(agrees)) return;
  events_.evidence.push_back(CloseVisit(static_cast<std::size_t>(visit - tree_.visits().data())));
  tree_.OpenVisit(seen.group, groups_, now_);
}

void TreeSlam::SetChain(int group) {
  const auto g = static_cast<std::size_t>(group);
  LandmarkGroup& landmark = groups_[g];
  const int modes = static_cast<int>(landmark.modes.size());
  landmark.chain = chains_[g].states() == modes + 1
                       ? chains_[g]
                       : ModeChain::Uniform(modes, chains_[g].leave_rate_per_s());
}

int TreeSlam::AddMode(int group) {
  LandmarkGroup& landmark = groups_[static_cast<std::size_t>(group)];
  Mode mode;
  mode.number = landmark.NextNumber();
  mode.last_seen = stamp_;
  landmark.modes.push_back(mode);
  SetChain(group);
  for (SlamLeaf* leaf : tree_.leaves().all()) leaf->filter.AddMode(group);
  tree_.AddState(group);
  return static_cast<int>(landmark.modes.size());
}

void TreeSlam::ReviseNewModes(int group) {
  const auto g = static_cast<std::size_t>(group);
  for (int state = static_cast<int>(groups_[g].modes.size()); state > confirmed_modes_[g];
       --state) {
    const SlamMap::ModeLandmark& mode = best().filter.mode(group, state);
    if (mode.landmark == SlamMap::kNoLandmark || mode.sightings < options_.min_sightings) {
      MergeMode(group, state, 0);
    } else if (const int duplicate = DuplicateOf(group, state); duplicate > 0) {
      MergeMode(group, state, duplicate);
      ++modes_merged_;
    }
  }
  confirmed_modes_[g] = static_cast<int>(groups_[g].modes.size());
}

// Modes are in the map of every leaf, T-IV V-A. One that took what was seen for something else gets
// a mode where the likeliest leaf sees it from the vehicle: as if seen once, now.
void TreeSlam::ShareModes(int group) {
  SlamMap& best = tree_.leaves().front().filter;
  const int modes = static_cast<int>(groups_[static_cast<std::size_t>(group)].modes.size());
  for (int state = 1; state <= modes; ++state) {
    const SlamMap::ModeLandmark& known = best.mode(group, state);
    for (SlamLeaf* leaf : tree_.leaves().all()) {
      SlamMap::ModeLandmark& mode = leaf->filter.mode(group, state);
      if (mode.landmark != SlamMap::kNoLandmark) continue;
      best.state().Activate(known.landmark);
      Observation seen;
      seen.kind = Observation::Kind::kCartesian;
      seen.z = best.state().RelativeTo(known.landmark).q_vehicle;
      mode = {leaf->filter.state().Add(seen), known.sightings};
    }
  }
}

int TreeSlam::DuplicateOf(int group, int state) {
  SlamMap& map = tree_.leaves().front().filter;
  const int landmark = map.mode(group, state).landmark;
  map.state().Activate(landmark);
  const Eigen::Matrix2d floor =
      Eigen::Matrix2d::Identity() * 2.0 * options_.position_floor_m * options_.position_floor_m;
  for (int other = 1; other < state; ++other) {
    const int duplicate = map.mode(group, other).landmark;
    if (duplicate == SlamMap::kNoLandmark) continue;
    map.state().Activate(duplicate);
    const Eigen::Vector2d apart = map.state().Position(duplicate) - map.state().Position(landmark);
    const Eigen::Matrix2d cov = map.state().DifferenceCovariance(duplicate, landmark) + floor;
    if (SquaredMahalanobis(apart, cov) <= gate_) return other;
  }
  return 0;
}

void TreeSlam::MergeMode(int group, int state, int into) {
  for (SlamLeaf* leaf : tree_.leaves().all()) {
    SlamMap& map = leaf->filter;
    SlamMap::ModeLandmark& gone = map.mode(group, state);
    if (into > 0 && gone.landmark != SlamMap::kNoLandmark) {
      SlamMap::ModeLandmark& kept = map.mode(group, into);
      if (kept.landmark == SlamMap::kNoLandmark) {
        std::swap(kept, gone);
      } else {
        map.state().Activate(kept.landmark);
        map.state().Activate(gone.landmark);
        map.state().Fuse(kept.landmark, gone.landmark);
        kept.sightings += gone.sightings;
        gone.landmark = SlamMap::kNoLandmark;
      }
    }
    if (gone.landmark != SlamMap::kNoLandmark) map.state().Remove(gone.landmark);
    map.EraseMode(group, state);
  }
  LandmarkGroup& landmark = groups_[static_cast<std::size_t>(group)];
  const auto gone = landmark.modes.begin() + state - 1;
  if (into > 0) {
    Mode& kept = landmark.modes[static_cast<std::size_t>(into) - 1];
    kept.last_seen = std::max(kept.last_seen, gone->last_seen);
  }
  landmark.modes.erase(gone);
  SetChain(group);
  tree_.MergeState(group, state, into);
}

MapContent TreeSlam::Content() {
  SlamMap& map = tree_.leaves().front().filter;
  map.state().Focus(std::numeric_limits<double>::max());
  MapContent content;
  content.stamp = stamp_;
  std::vector<int> order;
  for (int group = 0; group < static_cast<int>(groups_.size()); ++group) {
    if (!groups_[static_cast<std::size_t>(group)].modes.empty()) order.push_back(group);
  }
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    return groups_[static_cast<std::size_t>(a)].signature <
           groups_[static_cast<std::size_t>(b)].signature;
  });
  std::vector<int> landmarks;
  for (const int g : order) {
    LandmarkGroup group = groups_[static_cast<std::size_t>(g)];
    group.probabilities = Probabilities(g);
    for (std::size_t k = 0; k < group.modes.size(); ++k) {
      const int landmark = map.mode(g, static_cast<int>(k) + 1).landmark;
      landmarks.push_back(landmark);
      group.modes[k].p_map_landmark = map.state().Position(landmark);
      group.modes[k].cov_p_map_landmark = map.state().PositionCovariance(landmark);
    }
    content.groups.push_back(std::move(group));
  }
  content.covariance = JointCovariance::FromDense(map.state().LandmarkCovariance(landmarks));
  for (const AnonymousLandmark& landmark : map.anonymous()) {
    if (landmark.sightings < options_.anonymous_landmarks.confirm_sightings) continue;
    Mode mode;
    mode.p_map_landmark = map.state().Position(landmark.landmark);
    mode.cov_p_map_landmark = map.state().PositionCovariance(landmark.landmark) +
                              Eigen::Matrix2d::Identity() * kLeastSd * kLeastSd;
    mode.last_seen = landmark.last_seen;
    content.anonymous_landmarks.push_back(mode);
  }
  return content;
}

}  // namespace shiftmap

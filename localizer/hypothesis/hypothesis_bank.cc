// SPDX-License-Identifier: Apache-2.0
//
// The life of leaves and visits. How observations and misses count: hypothesis_scoring.cc.
#include "localizer/hypothesis/hypothesis_bank.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "localizer/hypothesis/leaf_reduction.h"
#include "localizer/hypothesis/sequential_test.h"
#include "localizer/models/detection_model.h"
#include "localizer/models/site_area.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// A prior never says that something cannot be: a state with probability zero could not recover.
constexpr double kMinProbability = 1e-6;

// Leaves lighter than this go.
constexpr double kMinLeafWeight = 1e-7;

// Leaves whose probabilities of a group differ by less agree about it.
constexpr double kAgreement = 1e-3;

// A state is given up only if the visit itself, and not its prior alone, speaks against it. [nat]
constexpr double kMinEvidence = 1.0;

Eigen::VectorXd Floored(const Eigen::VectorXd& probabilities) {
  const Eigen::VectorXd floored = probabilities.cwiseMax(kMinProbability);
  return floored / floored.sum();
}

Eigen::VectorXd LeafProbabilities(const GroupBelief& belief) {
  Eigen::VectorXd p(belief.states());
  for (int state = 0; state < p.size(); ++state) p[state] = std::exp(belief.LogProbability(state));
  return p;
}

// True if two leaves hold nearly the same probabilities of a group.
bool Agree(const GroupBelief& a, const GroupBelief& b) {
  for (int state = 0; state < a.states(); ++state) {
    const double difference = std::exp(a.LogProbability(state)) - std::exp(b.LogProbability(state));
    if (std::abs(difference) >= kAgreement) return false;
  }
  return true;
}

StateValues ValuesOf(const Eigen::VectorXd& vector) {
  return {vector.data(), vector.data() + vector.size()};
}

Eigen::Vector2d EdgeOfView(const SensorCalibration& sensor) {
  const double bearing = std::min(sensor.max_bearing_rad, std::numbers::pi);
  return {std::cos(bearing), std::sin(bearing)};
}

Eigen::VectorXd Exponential(const StateValues& log_p) { return AsVector(log_p).array().exp(); }

}  // namespace

HypothesisBank::HypothesisBank(MapSnapshot snapshot,
                               const HypothesisOptions& options,
                               const PoseWithCovariance& start,
                               Stamp stamp)
    : snapshot_(std::move(snapshot)),
      options_(options),
      grid_(snapshot_, snapshot_.calibration().sensor.max_range_m),
      gate_(ChiSquareQuantile(options.gate_probability, 2)),
      threshold_(DecisionThreshold(options.alpha)),
      unknown_place_density_(UnknownPlaceDensity(snapshot_)),
      edge_of_view_(EdgeOfView(snapshot_.calibration().sensor)),
      held_since_(snapshot_.groups().size()) {
  SHIFTMAP_CHECK(options.max_leaves >= 1, "max_leaves {}", options.max_leaves);
  for (const LandmarkGroup& group : snapshot_.groups()) {
    posteriors_.push_back({group.probabilities, snapshot_.stamp()});
  }
  Restart(start, stamp);
  ReserveMemory();
}

void HypothesisBank::ReserveMemory() {
  constexpr std::size_t kMostLeaves = 256;
  constexpr std::size_t kVisits = 64;
  std::size_t forks = 1;
  for (const LandmarkGroup& group : snapshot_.groups()) {
    forks = std::max(forks, group.modes.size() + 1);
  }
  const std::size_t leaves = forks * static_cast<std::size_t>(options_.max_leaves);
  leaves_.Reserve(std::min(leaves, kMostLeaves), kVisits, best());
  visits_.reserve(kVisits);
  must_agree_.reserve(kVisits);
  judged_.reserve(forks);
}

void BankEvents::Clear() {
  outcomes.clear();
  evidence.clear();
  decisions.clear();
  surprising.clear();
}

void HypothesisBank::Restart(const PoseWithCovariance& start, Stamp stamp) {
  stamp_ = stamp;
  must_agree_.clear();
  visits_.clear();
  leaves_.Clear();
  leaves_.Add({KnownMapFilter(start, snapshot_.calibration()), 0.0, {}});
}

void HypothesisBank::Predict(const MotionIncrement& increment, double elapsed_s) {
  T_odom_vehicle_ = T_odom_vehicle_ * increment.T_begin_end;
  for (Leaf* leaf : leaves_.all()) leaf->filter.Predict(increment, elapsed_s);
}

const BankEvents& HypothesisBank::Correct(const Scan& scan) {
  events_.Clear();
  stamp_ = scan.stamp;
  CloseStaleVisits(&events_.evidence);
  OpenVisitsInView(scan);
  for (std::size_t i = 0; i < scan.observations.size(); ++i) {
    const int group = snapshot_.GroupIndex(scan.observations[i].signature);
    if (group >= 0) Take(scan.observations[i], i, group);
  }
  for (const Visit& visit : visits_) {
    if (!visit.seen) Miss(visit.group);
  }
  Reduce();
  Test(&events_);
  ReleaseAgreedBeliefs();
  return events_;
}

std::vector<VisitEvidence> HypothesisBank::EndVisits() {
  std::vector<VisitEvidence> evidence;
  while (!visits_.empty()) evidence.push_back(CloseVisit(0));
  return evidence;
}

Eigen::VectorXd HypothesisBank::Probabilities(int group) const {
  const std::size_t index = BeliefIndex(group);
  if (index == leaves_.front().beliefs.size()) {
    const GroupPosterior& posterior = posteriors_[static_cast<std::size_t>(group)];
    return GroupAt(group).chain.Propagate(posterior.probabilities, stamp_ - posterior.stamp);
  }
  const StateValues log_p = MarginalLogProbability(leaves_, index);
  for (const Visit& visit : visits_) {
    if (visit.group == group) return Floored(Exponential(LogPosterior(visit, log_p)));
  }
  return GroupAt(group).chain.Propagate(Floored(Exponential(log_p)),
                                        stamp_ - held_since_[static_cast<std::size_t>(group)]);
}

Visit* HypothesisBank::FindVisit(int group) {
  const auto found =
      std::lower_bound(visits_.begin(), visits_.end(), group, [](const Visit& visit, int wanted) {
        return visit.group < wanted;
      });
  return found == visits_.end() || found->group != group ? nullptr : &*found;
}

std::size_t HypothesisBank::BeliefIndex(int group) const {
  const std::vector<GroupBelief>& beliefs = leaves_.front().beliefs;
  const auto found = std::lower_bound(
      beliefs.begin(), beliefs.end(), group, [](const GroupBelief& belief, int wanted) {
        return belief.group < wanted;
      });
  const bool held = found != beliefs.end() && found->group == group;
  return held ? static_cast<std::size_t>(found - beliefs.begin()) : beliefs.size();
}

// By a bound on the bearing's variance that needs no correlations: Var(a + b) <= 2 Var a + 2 Var b;
// and by the distance from the line along the edge of the sector, which is no more than range times
// angle. Spares most groups near the vehicle the exact probability.
bool HypothesisBank::FarOutsideSector(const Mode& mode) const {
  constexpr double kSigmas = 6.0;  // P_FOV < 1e-8, below any threshold.
  const KnownMapFilter& filter = best().filter;
  const Eigen::Vector2d q =
      filter.R_vehicle_map() * (mode.p_map_landmark - filter.T_map_vehicle().translation());
  const double outside_m = std::abs(q.y()) * edge_of_view_.x() - q.x() * edge_of_view_.y();
  if (outside_m <= 0.0) return false;
  const double of_pose = filter.covariance().topLeftCorner<2, 2>().trace() +
                         q.squaredNorm() * filter.covariance()(2, 2);
  const double variance = 4.0 * of_pose + 2.0 * mode.cov_p_map_landmark.trace();
  return outside_m * outside_m > kSigmas * kSigmas * variance;
}

bool HypothesisBank::InView(int group, double threshold) const {
  const int modes = static_cast<int>(GroupAt(group).modes.size());
  for (int state = 1; state <= modes; ++state) {
    if (FarOutsideSector(GroupAt(group).modes[static_cast<std::size_t>(state) - 1])) continue;
    const KnownMapFilter::Point point = best().filter.PredictPoint({group, state}, snapshot_);
    if (InViewProbability(point) > threshold) return true;
  }
  return false;
}

void HypothesisBank::OpenVisitsInView(const Scan& scan) {
  for (Visit& visit : visits_) {
    visit.seen = false;
    if (InView(visit.group, options_.fov_leave)) visit.end = stamp_;
  }
  const PoseWithCovariance pose = best().filter.Pose();
  const double max_range = snapshot_.calibration().sensor.max_range_m;
  const double sd = std::sqrt(pose.cov_T_map_vehicle.topLeftCorner<2, 2>().trace());
  grid_.GroupsNear(
      pose.T_map_vehicle.translation(), max_range + std::min(3.0 * sd, max_range), &nearby_);
  for (const int group : nearby_) {
    if (!FindVisit(group) && InView(group, options_.fov_enter)) OpenVisit(group);
  }
  for (const Observation& observation : scan.observations) {
    const int group = snapshot_.GroupIndex(observation.signature);
    if (group >= 0 && !FindVisit(group)) OpenVisit(group);
  }
}

void HypothesisBank::OpenVisit(int group) {
  must_agree_.clear();
  const LandmarkGroup& landmark = GroupAt(group);
  const GroupPosterior& posterior = posteriors_[static_cast<std::size_t>(group)];
  const std::size_t held = BeliefIndex(group);
  const bool is_held = held < leaves_.front().beliefs.size();
  Eigen::VectorXd prior = Eigen::VectorXd::Zero(landmark.probabilities.size());
  for (Leaf* leaf : leaves_.all()) {
    const Eigen::VectorXd p =
        is_held ? landmark.chain.Propagate(Floored(LeafProbabilities(leaf->beliefs[held])),
                                           stamp_ - held_since_[static_cast<std::size_t>(group)])
                : landmark.chain.Propagate(posterior.probabilities, stamp_ - posterior.stamp);
    GroupBelief belief;
    belief.group = group;
    belief.log_p = ValuesOf(Floored(p).array().log());
    belief.log_missed.resize(belief.log_p.size(), 0.0);
    prior += std::exp(leaf->log_weight) * Floored(p);
    if (is_held) {
      leaf->beliefs[held] = belief;
    } else {
      const auto place =
          std::find_if(leaf->beliefs.begin(), leaf->beliefs.end(), [&](const GroupBelief& other) {
            return other.group > group;
          });
      leaf->beliefs.insert(place, belief);
    }
  }
  Visit visit;
  visit.group = group;
  visit.begin = stamp_;
  visit.end = stamp_;
  visit.log_prior = ValuesOf((prior / prior.sum()).array().log());
  visit.given_up.resize(visit.log_prior.size());
  const auto place = std::find_if(
      visits_.begin(), visits_.end(), [&](const Visit& other) { return other.group > group; });
  visits_.insert(place, std::move(visit));
}

VisitEvidence HypothesisBank::CloseVisit(std::size_t visit_index) {
  must_agree_.clear();
  const Visit visit = visits_[visit_index];
  const std::size_t index = BeliefIndex(visit.group);
  const StateValues log_posterior = LogPosterior(visit, MarginalLogProbability(leaves_, index));
  visits_.erase(visits_.begin() + static_cast<std::ptrdiff_t>(visit_index));
  if (LeavesAgree(index)) {
    posteriors_[static_cast<std::size_t>(visit.group)] = {Floored(Exponential(log_posterior)),
                                                          visit.end};
    EraseBelief(index);
  } else {
    held_since_[static_cast<std::size_t>(visit.group)] = visit.end;
  }
  return EvidenceOf(visit, log_posterior, GroupAt(visit.group));
}

bool HypothesisBank::LeavesAgree(std::size_t index) const {
  const GroupBelief& first = best().beliefs[index];
  return std::all_of(leaves_.all().begin(), leaves_.all().end(), [&](const Leaf* leaf) {
    return Agree(leaf->beliefs[index], first);
  });
}

void HypothesisBank::EraseBelief(std::size_t index) {
  must_agree_.clear();
  for (Leaf* leaf : leaves_.all()) {
    leaf->beliefs.erase(leaf->beliefs.begin() + static_cast<std::ptrdiff_t>(index));
  }
}

void HypothesisBank::CloseStaleVisits(std::vector<VisitEvidence>* evidence) {
  const Duration gap = FromSeconds(options_.visit_gap_s);
  for (std::size_t i = 0; i < visits_.size();) {
    if (stamp_ - visits_[i].end > gap) {
      evidence->push_back(CloseVisit(i));
    } else {
      ++i;
    }
  }
}

void HypothesisBank::ReleaseAgreedBeliefs() {
  for (std::size_t i = 0; i < leaves_.front().beliefs.size();) {
    const int group = leaves_.front().beliefs[i].group;
    if (FindVisit(group) || !LeavesAgree(i)) {
      ++i;
      continue;
    }
    posteriors_[static_cast<std::size_t>(group)] = {
        Floored(Exponential(MarginalLogProbability(leaves_, i))),
        held_since_[static_cast<std::size_t>(group)]};
    EraseBelief(i);
  }
}

// A decision is said, and leaves that speak against it stay until they are hopeless: the other
// groups' decisions rest on the same pose, and would else be as wrong as the first without knowing.
void HypothesisBank::Test(BankEvents* events) {
  for (Visit& visit : visits_) {
    if (visit.observations == 0 || visit.Settled()) continue;
    const std::size_t index = BeliefIndex(visit.group);
    const StateValues log_alive = MarginalLogProbability(leaves_, index);
    const TestOutcome outcome = TestStates(AsVector(log_alive), threshold_);
    const bool seen_there =
        outcome.decided.value_or(0) == 0 || best().beliefs[index].resolved == *outcome.decided;
    if (outcome.decided && outcome.decided != visit.decided && seen_there) {
      Decide(*outcome.decided, outcome.log_odds, &visit, events);
    }
    if (!outcome.hopeless.empty()) GiveUp(outcome.hopeless, log_alive, index, &visit);
  }
}

void HypothesisBank::GiveUp(const HopelessStates& states,
                            const StateValues& log_alive,
                            std::size_t belief_index,
                            Visit* visit) {
  const StateValues log_p = LogPosterior(*visit, log_alive);
  for (const int state : states) {
    const auto i = static_cast<std::size_t>(state);
    if (visit->given_up[i] || log_p[i] > visit->log_prior[i] - kMinEvidence) continue;
    visit->given_up[i] = log_p[i];
    Exclude(belief_index, state, &leaves_);
    Reduce();
  }
}

void HypothesisBank::Decide(int state, double log_odds, Visit* visit, BankEvents* events) const {
  visit->decided = state;
  int favourite = 0;
  AsVector(visit->log_prior).maxCoeff(&favourite);
  const LandmarkGroup& landmark = GroupAt(visit->group);
  events->decisions.push_back({landmark.signature, landmark.NumberOf(state), stamp_, log_odds});
  events->surprising.push_back(favourite != state);
}

void HypothesisBank::Reduce() {
  NormalizeWeights(&leaves_);
  if (must_agree_.empty()) {
    for (const GroupBelief& belief : leaves_.front().beliefs) {
      must_agree_.push_back(FindVisit(belief.group) != nullptr);
    }
  }
  MergeLeaves(must_agree_, &leaves_);
  const double dropped = KeepHeaviest(options_.max_leaves, kMinLeafWeight, &leaves_);
  dropped_mass_max_ = std::max(dropped_mass_max_, dropped);
  leaves_max_ = std::max(leaves_max_, static_cast<int>(leaves_.size()));
}

}  // namespace shiftmap

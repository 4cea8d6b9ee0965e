// SPDX-License-Identifier: Apache-2.0
//
// The life of leaves and visits. How observations and misses count: hypothesis_scoring.cc.
#include "localizer/hypothesis/hypothesis_bank.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "localizer/hypothesis/leaf_reduction.h"
#include "localizer/hypothesis/sequential_test.h"
#include "localizer/models/detection_model.h"
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

// Observations in a row that overturn a decision: the landmark did move in view, or it was wrong.
constexpr int kMaxContradictions = 5;

Eigen::VectorXd Floored(const Eigen::VectorXd& probabilities) {
  const Eigen::VectorXd floored = probabilities.cwiseMax(kMinProbability);
  return floored / floored.sum();
}

Eigen::VectorXd LeafProbabilities(const GroupBelief& belief) {
  Eigen::VectorXd p(belief.log_p.size());
  for (int state = 0; state < p.size(); ++state) p[state] = std::exp(belief.LogProbability(state));
  return p;
}

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
      held_since_(snapshot_.groups().size()) {
  SHIFTMAP_CHECK(options.max_leaves >= 1, "max_leaves {}", options.max_leaves);
  for (const LandmarkGroup& group : snapshot_.groups()) {
    posteriors_.push_back({Floored(group.probabilities), snapshot_.stamp()});
  }
  Restart(start, stamp);
}

void HypothesisBank::Restart(const PoseWithCovariance& start, Stamp stamp) {
  stamp_ = stamp;
  visits_.clear();
  leaves_.clear();
  leaves_.push_back({KnownMapFilter(start, snapshot_.calibration()), 0.0, {}});
}

void HypothesisBank::Predict(const MotionIncrement& increment, double elapsed_s) {
  for (Leaf& leaf : leaves_) leaf.filter.Predict(increment, elapsed_s);
}

BankEvents HypothesisBank::Correct(const Scan& scan) {
  BankEvents events;
  stamp_ = scan.stamp;
  CloseStaleVisits(&events.evidence);
  OpenVisitsInView(scan);
  for (std::size_t i = 0; i < scan.observations.size(); ++i) {
    const Observation& observation = scan.observations[i];
    const int group = snapshot_.GroupIndex(observation.signature);
    if (group < 0) continue;
    ObservationOutcome outcome = Judge(observation, group);
    outcome.index = i;
    events.outcomes.push_back(outcome);

    Visit* visit = FindVisit(group);
    if (visit->decided) {
      const bool agrees = *visit->decided == 0 ? !outcome.gated_any : outcome.gated;
      visit->contradictions = agrees ? 0 : visit->contradictions + 1;
      if (visit->contradictions >= kMaxContradictions) {
        events.evidence.push_back(CloseVisit(static_cast<std::size_t>(visit - visits_.data())));
        OpenVisit(group);
        visit = FindVisit(group);
      }
    }
    visit->end = stamp_;
    visit->seen = true;
    ++visit->observations;
    Observe(observation, group, ViewWeight(visit));
    Reduce();
  }
  for (const Visit& visit : visits_) {
    if (!visit.seen) Miss(visit.group);
  }
  Reduce();
  Test(&events);
  ReleaseAgreedBeliefs();
  return events;
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
  const Eigen::VectorXd log_p = MarginalLogProbability(leaves_, index);
  for (const Visit& visit : visits_) {
    if (visit.group == group) return Floored(LogPosterior(visit, log_p).array().exp());
  }
  return GroupAt(group).chain.Propagate(Floored(log_p.array().exp()),
                                        stamp_ - held_since_[static_cast<std::size_t>(group)]);
}

Visit* HypothesisBank::FindVisit(int group) {
  const auto found = std::find_if(
      visits_.begin(), visits_.end(), [&](const Visit& visit) { return visit.group == group; });
  return found == visits_.end() ? nullptr : &*found;
}

std::size_t HypothesisBank::BeliefIndex(int group) const {
  const std::vector<GroupBelief>& beliefs = leaves_.front().beliefs;
  const auto found = std::find_if(beliefs.begin(), beliefs.end(), [&](const GroupBelief& belief) {
    return belief.group == group;
  });
  return static_cast<std::size_t>(found - beliefs.begin());
}

bool HypothesisBank::InView(int group, double threshold) const {
  const int modes = static_cast<int>(GroupAt(group).modes.size());
  for (int state = 1; state <= modes; ++state) {
    const KnownMapFilter::Point point = best().filter.PredictPoint({group, state}, snapshot_);
    const double p = SectorFieldOfView(
        point.RangeBearing(), point.CovRangeBearing(), snapshot_.calibration().sensor);
    if (p > threshold) return true;
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
  const LandmarkGroup& landmark = GroupAt(group);
  const GroupPosterior& posterior = posteriors_[static_cast<std::size_t>(group)];
  const std::size_t held = BeliefIndex(group);
  const bool is_held = held < leaves_.front().beliefs.size();
  Eigen::VectorXd prior = Eigen::VectorXd::Zero(landmark.probabilities.size());
  for (Leaf& leaf : leaves_) {
    const Eigen::VectorXd p =
        is_held ? landmark.chain.Propagate(Floored(LeafProbabilities(leaf.beliefs[held])),
                                           stamp_ - held_since_[static_cast<std::size_t>(group)])
                : landmark.chain.Propagate(posterior.probabilities, stamp_ - posterior.stamp);
    GroupBelief belief;
    belief.group = group;
    belief.log_p = Floored(p).array().log();
    belief.log_missed = Eigen::VectorXd::Zero(p.size());
    prior += std::exp(leaf.log_weight) * Floored(p);
    if (is_held) {
      leaf.beliefs[held] = belief;
    } else {
      const auto place =
          std::find_if(leaf.beliefs.begin(), leaf.beliefs.end(), [&](const GroupBelief& other) {
            return other.group > group;
          });
      leaf.beliefs.insert(place, belief);
    }
  }
  Visit visit;
  visit.group = group;
  visit.begin = stamp_;
  visit.end = stamp_;
  visit.log_prior = (prior / prior.sum()).array().log();
  visit.given_up.resize(static_cast<std::size_t>(prior.size()));
  const auto place = std::find_if(
      visits_.begin(), visits_.end(), [&](const Visit& other) { return other.group > group; });
  visits_.insert(place, std::move(visit));
}

VisitEvidence HypothesisBank::CloseVisit(std::size_t visit_index) {
  const Visit visit = visits_[visit_index];
  const std::size_t index = BeliefIndex(visit.group);
  const Eigen::VectorXd log_posterior = LogPosterior(visit, MarginalLogProbability(leaves_, index));
  visits_.erase(visits_.begin() + static_cast<std::ptrdiff_t>(visit_index));
  if (visit.decided || leaves_.size() == 1) {
    posteriors_[static_cast<std::size_t>(visit.group)] = {Floored(log_posterior.array().exp()),
                                                          visit.end};
    for (Leaf& leaf : leaves_) {
      leaf.beliefs.erase(leaf.beliefs.begin() + static_cast<std::ptrdiff_t>(index));
    }
  } else {
    held_since_[static_cast<std::size_t>(visit.group)] = visit.end;
  }
  return EvidenceOf(visit, log_posterior, GroupAt(visit.group));
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
    const Eigen::VectorXd first = LeafProbabilities(leaves_.front().beliefs[i]);
    const bool agreed = std::all_of(leaves_.begin(), leaves_.end(), [&](const Leaf& leaf) {
      return (LeafProbabilities(leaf.beliefs[i]) - first).cwiseAbs().maxCoeff() < kAgreement;
    });
    if (FindVisit(group) || !agreed) {
      ++i;
      continue;
    }
    posteriors_[static_cast<std::size_t>(group)] = {
        Floored(MarginalLogProbability(leaves_, i).array().exp()),
        held_since_[static_cast<std::size_t>(group)]};
    for (Leaf& leaf : leaves_) {
      leaf.beliefs.erase(leaf.beliefs.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }
}

void HypothesisBank::Test(BankEvents* events) {
  for (Visit& visit : visits_) {
    if (visit.decided || visit.observations == 0) continue;
    const std::size_t index = BeliefIndex(visit.group);
    const Eigen::VectorXd log_alive = MarginalLogProbability(leaves_, index);
    const Eigen::VectorXd log_p = LogPosterior(visit, log_alive);
    const TestOutcome outcome = TestStates(log_alive, threshold_);

    const bool seen_there =
        outcome.decided.value_or(0) == 0 || best().beliefs[index].resolved == *outcome.decided;
    if (outcome.decided && seen_there) {
      visit.decided = outcome.decided;
      for (int state = 0; state < log_p.size(); ++state) {
        std::optional<double>& given_up = visit.given_up[static_cast<std::size_t>(state)];
        if (state != *visit.decided && !given_up) given_up = log_p[state];
      }
      int favourite = 0;
      visit.log_prior.maxCoeff(&favourite);
      const LandmarkGroup& landmark = GroupAt(visit.group);
      events->decisions.push_back(
          {landmark.signature, landmark.NumberOf(*visit.decided), stamp_, outcome.log_odds});
      events->surprising.push_back(favourite != *visit.decided);
      ConditionOn(index, *visit.decided, &leaves_);
      Reduce();
      continue;
    }
    for (const int state : outcome.hopeless) {
      std::optional<double>& given_up = visit.given_up[static_cast<std::size_t>(state)];
      if (given_up || log_p[state] > visit.log_prior[state] - kMinEvidence) continue;
      given_up = log_p[state];
      Exclude(index, state, &leaves_);
      Reduce();
    }
  }
}

void HypothesisBank::Reduce() {
  NormalizeWeights(&leaves_);
  MergeLeaves([&](int group) { return FindVisit(group) != nullptr; }, &leaves_);
  const double dropped = KeepHeaviest(options_.max_leaves, kMinLeafWeight, &leaves_);
  dropped_mass_max_ = std::max(dropped_mass_max_, dropped);
  leaves_max_ = std::max(leaves_max_, static_cast<int>(leaves_.size()));
}

}  // namespace shiftmap

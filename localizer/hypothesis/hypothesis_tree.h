// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "localizer/hypothesis/leaf_reduction.h"
#include "localizer/hypothesis/leaf_set.h"
#include "localizer/hypothesis/sequential_test.h"
#include "localizer/hypothesis/visit.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/landmark_group.h"

namespace shiftmap {

struct TreeLimits {
  /// Accepted probability of a wrong decision, in (0, 0.5).
  double alpha = 1e-4;
  /// Leaves kept at most, >= 1.
  int max_leaves = 48;
  /// A visit ends when its group was out of view and unseen for this long, > 0. [s]
  double visit_gap_s = 5.0;
};

/// A decision of the sequential test, and whether another mode was likelier before the visit.
struct TreeDecision {
  Decision decision;
  bool surprising = false;
};

/// The hypothesis tree of T-IV V, for any filter: its leaves, and the visits in which groups are
/// evaluated. It knows how leaves are merged, bounded and pruned by decisions, and where the
/// probabilities of a group come from before, during and after a visit. How observations weigh and
/// fork the leaves is up to its owner, as is the list of groups, which every call gets.
///
/// Inner nodes are not stored: their scores are sums over leaves, T-IV (25). TreeView shows them.
///
/// Memory: reuses what it had; see LeafSet. Threads: none. Determinism: the same calls give the
/// same bits.
template <class LeafType>
class HypothesisTree {
 public:
  using Groups = std::vector<LandmarkGroup>;

  /// @param stamp  At which the probabilities of `groups` hold.
  HypothesisTree(const TreeLimits& limits, const Groups& groups, Stamp stamp);

  /// Starts again with one leaf: leaves and open visits go, what ended visits decided stays.
  void Restart(const LeafType& root);

  /// What visits that ended at `since` or later said of a group does not hold: its probabilities
  /// are those of `groups` again, at `stamp`.
  void ForgetSince(Stamp since, const Groups& groups, Stamp stamp);

  /// Makes memory for leaves of `forks` children each.
  void Reserve(std::size_t forks);

  LeafSet<LeafType>& leaves() { return leaves_; }
  const LeafSet<LeafType>& leaves() const { return leaves_; }
  const LeafType& best() const { return leaves_.front(); }
  std::vector<Visit>& visits() { return visits_; }
  const std::vector<Visit>& visits() const { return visits_; }

  Visit* FindVisit(int group);

  /// Into Leaf::beliefs; their number if leaves hold none about the group.
  std::size_t BeliefIndex(int group) const;

  /// An unresolved belief with these probabilities, none of them taken as 0.
  static typename LeafType::Belief BeliefOf(int group, const Eigen::VectorXd& probabilities) {
    typename LeafType::Belief belief;
    belief.group = group;
    belief.log_p = ValuesOf(Floored(probabilities).array().log());
    belief.log_missed.resize(belief.log_p.size(), 0.0);
    return belief;
  }

  /// Begins to evaluate a group: each leaf gets the chain's distribution at `now`, T-IV (13).
  void OpenVisit(int group, const Groups& groups, Stamp now);

  /// Gives all leaves a belief about a group that none holds and no visit evaluates: its
  /// probabilities now.
  void Hold(int group, const Groups& groups, Stamp now);

  /// Ends the visit at `visit_index`. Leaves that disagree go on holding their beliefs.
  VisitEvidence CloseVisit(std::size_t visit_index, const Groups& groups);

  /// Calls `close` with the index of each visit whose group was out of view and unseen for too
  /// long; it has to end the visit.
  template <class Close>
  void CloseStaleVisits(Stamp now, const Close& close) {
    const Duration gap = FromSeconds(limits_.visit_gap_s);
    for (std::size_t i = 0; i < visits_.size();) {
      if (now - visits_[i].end > gap) {
        close(i);
      } else {
        ++i;
      }
    }
  }

  /// Forgets beliefs outside of visits about which all leaves agree by now.
  void ReleaseAgreedBeliefs();

  /// The sequential tests of all visits, T-IV (17), (18). Leaves that contradict a
  /// decision stay until they are rejected: all decisions share the pose, and to remove these
  /// leaves would pass one error on to the others.
  void Test(const Groups& groups, Stamp now, std::vector<TreeDecision>* decisions);

  /// Merges and bounds the leaves; weights sum to 1 after it.
  void Reduce();

  /// Probability of each state of a group at `now`; never exactly 0 or 1.
  Eigen::VectorXd Probabilities(int group, const Groups& groups, Stamp now) const;

  /// A group that nobody evaluates, at the end of `groups`.
  void AddGroup(const Eigen::VectorXd& probabilities, Stamp stamp);

  /// A group has one mode more: its last state, impossible so far in all leaves. In a visit under
  /// way it counts as what `absent` stood for.
  void AddState(int group);

  /// A state >= 1 turns out to be the state `into` before it, with whose probability its own counts
  /// from now on: another mode, or `absent`. States after it move up.
  void MergeState(int group, int state, int into);

  /// Largest probability mass that the bound on the leaves cost in one step.
  double dropped_mass_max() const { return dropped_mass_max_; }
  int leaves_max() const { return leaves_max_; }

 private:
  struct GroupPosterior {
    Eigen::VectorXd probabilities;
    Stamp stamp;
  };

  // A prior never says that something cannot be: a state with probability zero could not recover.
  static constexpr double kMinProbability = 1e-6;
  // Leaves lighter than this go.
  static constexpr double kMinLeafWeight = 1e-7;
  // Leaves whose probabilities of a group differ by less agree about it.
  static constexpr double kAgreement = 1e-3;
  // A state is given up only if the visit itself, and not its prior alone, speaks against it. [nat]
  static constexpr double kMinEvidence = 1.0;

  static Eigen::VectorXd Floored(const Eigen::VectorXd& probabilities) {
    const Eigen::VectorXd floored = probabilities.cwiseMax(kMinProbability);
    return floored / floored.sum();
  }
  static Eigen::VectorXd Exponential(const StateValues& log_p) {
    return AsVector(log_p).array().exp();
  }
  static StateValues ValuesOf(const Eigen::VectorXd& vector) {
    return {vector.data(), vector.data() + vector.size()};
  }
  static bool Agree(const GroupBelief& a, const GroupBelief& b);
  static Eigen::VectorXd LeafProbabilities(const GroupBelief& belief);

  GroupPosterior& PosteriorOf(int group) { return posteriors_[static_cast<std::size_t>(group)]; }
  const GroupPosterior& PosteriorOf(int group) const {
    return posteriors_[static_cast<std::size_t>(group)];
  }
  Stamp HeldSince(int group) const { return held_since_[static_cast<std::size_t>(group)]; }
  bool LeavesAgree(std::size_t index) const;
  void EraseBelief(std::size_t index);
  void Decide(int state,
              double log_odds,
              const LandmarkGroup& landmark,
              Stamp now,
              Visit* visit,
              std::vector<TreeDecision>* decisions) const;
  void Reject(const RejectedStates& states,
              const StateValues& log_alive,
              std::size_t belief_index,
              Visit* visit);

  TreeLimits limits_;
  double threshold_;                        // Of the sequential test.
  LeafSet<LeafType> leaves_;                // By descending weight.
  std::vector<Visit> visits_;               // Open ones, by group.
  std::vector<GroupPosterior> posteriors_;  // Per group, for those without a belief.
  std::vector<Stamp> held_since_;           // Per group: end of the visit whose belief leaves hold.
  std::vector<bool> must_agree_;  // By belief: its visit is open. Empty if not up to date.
  double dropped_mass_max_ = 0.0;
  int leaves_max_ = 1;
};

template <class LeafType>
HypothesisTree<LeafType>::HypothesisTree(const TreeLimits& limits,
                                         const Groups& groups,
                                         Stamp stamp)
    : limits_(limits), threshold_(DecisionThreshold(limits.alpha)), held_since_(groups.size()) {
  SHIFTMAP_CHECK(limits.max_leaves >= 1, "max_leaves {}", limits.max_leaves);
  for (const LandmarkGroup& group : groups) posteriors_.push_back({group.probabilities, stamp});
}

template <class LeafType>
void HypothesisTree<LeafType>::Restart(const LeafType& root) {
  must_agree_.clear();
  visits_.clear();
  leaves_.Clear();
  leaves_.Add(root);
}

template <class LeafType>
void HypothesisTree<LeafType>::ForgetSince(Stamp since, const Groups& groups, Stamp stamp) {
  for (std::size_t group = 0; group < posteriors_.size(); ++group) {
    if (posteriors_[group].stamp >= since)
      posteriors_[group] = {groups[group].probabilities, stamp};
  }
}

template <class LeafType>
void HypothesisTree<LeafType>::Reserve(std::size_t forks) {
  constexpr std::size_t kMostLeaves = 256;
  constexpr std::size_t kVisits = 64;
  const std::size_t leaves = forks * static_cast<std::size_t>(limits_.max_leaves);
  leaves_.Reserve(std::min(leaves, kMostLeaves), kVisits, best());
  visits_.reserve(kVisits);
  must_agree_.reserve(kVisits);
}

template <class LeafType>
Visit* HypothesisTree<LeafType>::FindVisit(int group) {
  const auto found =
      std::lower_bound(visits_.begin(), visits_.end(), group, [](const Visit& visit, int wanted) {
        return visit.group < wanted;
      });
  return found == visits_.end() || found->group != group ? nullptr : &*found;
}

template <class LeafType>
std::size_t HypothesisTree<LeafType>::BeliefIndex(int group) const {
  const auto& beliefs = leaves_.front().beliefs;
  const auto found = std::lower_bound(
      beliefs.begin(), beliefs.end(), group, [](const GroupBelief& belief, int wanted) {
        return belief.group < wanted;
      });
  const bool held = found != beliefs.end() && found->group == group;
  return held ? static_cast<std::size_t>(found - beliefs.begin()) : beliefs.size();
}

template <class LeafType>
void HypothesisTree<LeafType>::OpenVisit(int group, const Groups& groups, Stamp now) {
  must_agree_.clear();
  const LandmarkGroup& landmark = groups[static_cast<std::size_t>(group)];
  const GroupPosterior& posterior = PosteriorOf(group);
  const std::size_t held = BeliefIndex(group);
  const bool is_held = held < leaves_.front().beliefs.size();
  const Eigen::VectorXd unheld =
      is_held ? Eigen::VectorXd()
              : landmark.chain.Propagate(posterior.probabilities, posterior.stamp, now);
  Eigen::VectorXd prior = Eigen::VectorXd::Zero(landmark.chain.states());
  for (LeafType* leaf : leaves_.all()) {
    const Eigen::VectorXd p =
        is_held ? landmark.chain.Propagate(
                      Floored(LeafProbabilities(leaf->beliefs[held])), HeldSince(group), now)
                : unheld;
    const typename LeafType::Belief belief = BeliefOf(group, p);
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
  visit.begin = now;
  visit.end = now;
  visit.log_prior = ValuesOf((prior / prior.sum()).array().log());
  visit.given_up.resize(visit.log_prior.size());
  const auto place = std::find_if(
      visits_.begin(), visits_.end(), [&](const Visit& other) { return other.group > group; });
  visits_.insert(place, std::move(visit));
}

template <class LeafType>
void HypothesisTree<LeafType>::Hold(int group, const Groups& groups, Stamp now) {
  if (BeliefIndex(group) < leaves_.front().beliefs.size()) return;
  OpenVisit(group, groups, now);
  visits_.erase(visits_.begin() + (FindVisit(group) - visits_.data()));
  held_since_[static_cast<std::size_t>(group)] = now;
}

template <class LeafType>
VisitEvidence HypothesisTree<LeafType>::CloseVisit(std::size_t visit_index, const Groups& groups) {
  must_agree_.clear();
  const Visit visit = visits_[visit_index];
  const std::size_t index = BeliefIndex(visit.group);
  const StateValues log_posterior =
      visit.confirmed ? LogPosterior(visit, MarginalLogProbability(leaves_, index))
                      : visit.log_prior;
  visits_.erase(visits_.begin() + static_cast<std::ptrdiff_t>(visit_index));
  if (!visit.confirmed || LeavesAgree(index)) {
    PosteriorOf(visit.group) = {Floored(Exponential(log_posterior)), visit.end};
    EraseBelief(index);
  } else {
    held_since_[static_cast<std::size_t>(visit.group)] = visit.end;
  }
  return EvidenceOf(visit, log_posterior, groups[static_cast<std::size_t>(visit.group)]);
}

template <class LeafType>
bool HypothesisTree<LeafType>::Agree(const GroupBelief& a, const GroupBelief& b) {
  for (int state = 0; state < a.states(); ++state) {
    const double difference = std::exp(a.LogProbability(state)) - std::exp(b.LogProbability(state));
    if (std::abs(difference) >= kAgreement) return false;
  }
  return true;
}

template <class LeafType>
Eigen::VectorXd HypothesisTree<LeafType>::LeafProbabilities(const GroupBelief& belief) {
  Eigen::VectorXd p(belief.states());
  for (int state = 0; state < p.size(); ++state) p[state] = std::exp(belief.LogProbability(state));
  return p;
}

template <class LeafType>
bool HypothesisTree<LeafType>::LeavesAgree(std::size_t index) const {
  const GroupBelief& first = best().beliefs[index];
  return std::all_of(leaves_.all().begin(), leaves_.all().end(), [&](const LeafType* leaf) {
    return Agree(leaf->beliefs[index], first);
  });
}

template <class LeafType>
void HypothesisTree<LeafType>::EraseBelief(std::size_t index) {
  must_agree_.clear();
  for (LeafType* leaf : leaves_.all()) {
    leaf->beliefs.erase(leaf->beliefs.begin() + static_cast<std::ptrdiff_t>(index));
  }
}

template <class LeafType>
void HypothesisTree<LeafType>::ReleaseAgreedBeliefs() {
  for (std::size_t i = 0; i < leaves_.front().beliefs.size();) {
    const int group = leaves_.front().beliefs[i].group;
    if (FindVisit(group) || !LeavesAgree(i)) {
      ++i;
      continue;
    }
    PosteriorOf(group) = {Floored(Exponential(MarginalLogProbability(leaves_, i))),
                          HeldSince(group)};
    EraseBelief(i);
  }
}

template <class LeafType>
void HypothesisTree<LeafType>::Test(const Groups& groups,
                                    Stamp now,
                                    std::vector<TreeDecision>* decisions) {
  for (Visit& visit : visits_) {
    if (visit.observations == 0 || visit.Settled()) continue;
    const std::size_t index = BeliefIndex(visit.group);
    const StateValues log_alive = MarginalLogProbability(leaves_, index);
    const TestOutcome outcome = TestStates(AsVector(log_alive), threshold_);
    const bool seen_there = outcome.decided.value_or(0) == 0
                                ? !visit.explained
                                : best().beliefs[index].resolved == *outcome.decided;
    if (!visit.confirmed && outcome.decided != visit.Favourite()) continue;
    if (outcome.decided && outcome.decided != visit.decided && seen_there) {
      Decide(*outcome.decided,
             outcome.log_odds,
             groups[static_cast<std::size_t>(visit.group)],
             now,
             &visit,
             decisions);
    }
    if (!outcome.rejected.empty() && visit.confirmed)
      Reject(outcome.rejected, log_alive, index, &visit);
  }
}

template <class LeafType>
void HypothesisTree<LeafType>::Reject(const RejectedStates& states,
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

template <class LeafType>
void HypothesisTree<LeafType>::Decide(int state,
                                      double log_odds,
                                      const LandmarkGroup& landmark,
                                      Stamp now,
                                      Visit* visit,
                                      std::vector<TreeDecision>* decisions) const {
  visit->decided = state;
  decisions->push_back(
      {{landmark.signature, landmark.NumberOf(state), now, log_odds}, visit->Favourite() != state});
}

template <class LeafType>
void HypothesisTree<LeafType>::Reduce() {
  NormalizeWeights(&leaves_);
  if (must_agree_.empty()) {
    for (const GroupBelief& belief : leaves_.front().beliefs) {
      must_agree_.push_back(FindVisit(belief.group) != nullptr);
    }
  }
  MergeLeaves(must_agree_, &leaves_);
  const double dropped = KeepHeaviest(limits_.max_leaves, kMinLeafWeight, &leaves_);
  dropped_mass_max_ = std::max(dropped_mass_max_, dropped);
  leaves_max_ = std::max(leaves_max_, static_cast<int>(leaves_.size()));
}

template <class LeafType>
Eigen::VectorXd HypothesisTree<LeafType>::Probabilities(int group,
                                                        const Groups& groups,
                                                        Stamp now) const {
  const ModeChain& chain = groups[static_cast<std::size_t>(group)].chain;
  const std::size_t index = BeliefIndex(group);
  if (index == leaves_.front().beliefs.size()) {
    const GroupPosterior& posterior = PosteriorOf(group);
    return chain.Propagate(posterior.probabilities, posterior.stamp, now);
  }
  const StateValues log_p = MarginalLogProbability(leaves_, index);
  for (const Visit& visit : visits_) {
    if (visit.group == group) return Floored(Exponential(LogPosterior(visit, log_p)));
  }
  return chain.Propagate(Floored(Exponential(log_p)), HeldSince(group), now);
}

template <class LeafType>
void HypothesisTree<LeafType>::AddGroup(const Eigen::VectorXd& probabilities, Stamp stamp) {
  posteriors_.push_back({probabilities, stamp});
  held_since_.emplace_back();
}

template <class LeafType>
void HypothesisTree<LeafType>::AddState(int group) {
  Eigen::VectorXd& p = PosteriorOf(group).probabilities;
  p.conservativeResize(p.size() + 1);
  p[p.size() - 1] = 0.0;
  if (Visit* visit = FindVisit(group)) {
    visit->log_prior.push_back(visit->log_prior.front());
    visit->given_up.emplace_back();
  }
  const std::size_t index = BeliefIndex(group);
  if (index == leaves_.front().beliefs.size()) return;
  for (LeafType* leaf : leaves_.all()) {
    leaf->beliefs[index].log_p.push_back(kLogZero);
    leaf->beliefs[index].log_missed.push_back(0.0);
  }
}

template <class LeafType>
void HypothesisTree<LeafType>::MergeState(int group, int state, int into) {
  const auto renumbered = [&](int old) {
    if (old == state) return into;
    return old > state ? old - 1 : old;
  };
  Eigen::VectorXd& p = PosteriorOf(group).probabilities;
  p[into] += p[state];
  const Eigen::Index after = p.size() - state - 1;
  p.segment(state, after) = p.tail(after).eval();
  p.conservativeResize(p.size() - 1);
  if (Visit* visit = FindVisit(group)) {
    const auto i = static_cast<std::size_t>(state);
    if (!visit->given_up[i]) visit->given_up[static_cast<std::size_t>(into)].reset();
    visit->given_up.erase(visit->given_up.begin() + state);
    visit->log_prior.erase(visit->log_prior.begin() + state);
    if (visit->decided) visit->decided = renumbered(*visit->decided);
  }
  const std::size_t index = BeliefIndex(group);
  if (index == leaves_.front().beliefs.size()) return;
  for (LeafType* leaf : leaves_.all()) {
    auto& belief = leaf->beliefs[index];
    if (belief.resolved == state && into == 0) {
      belief.resolved = GroupBelief::kUnresolved;
      AsVector(belief.log_p).setConstant(kLogZero);
      belief.log_p[0] = 0.0;
    } else if (belief.resolved == GroupBelief::kUnresolved) {
      double& log_p = belief.log_p[static_cast<std::size_t>(into)];
      log_p = LogAdd(log_p, belief.log_p[static_cast<std::size_t>(state)]);
    } else {
      belief.resolved = renumbered(belief.resolved);
    }
    belief.log_p.erase(belief.log_p.begin() + state);
    belief.log_missed.erase(belief.log_missed.begin() + state);
  }
}

}  // namespace shiftmap

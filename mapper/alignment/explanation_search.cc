// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/explanation_search.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <queue>
#include <unordered_set>
#include <utility>

#include "localizer/hypothesis/log_math.h"
#include "mapper/alignment/all_moved.h"
#include "mapper/alignment/moved_bodies.h"
#include "mapper/alignment/rigid_bodies.h"

namespace shiftmap {
namespace {

// Sets that are less likely than the best by more are not looked at. [nats]
constexpr double kWindow = 12.0;

// Sets whose neighbours are looked at.
constexpr int kMaxSetsExpanded = 400;

// Of two landmarks that stayed the distances agree to this, in standard deviations.
constexpr double kPairGate = 4.0;

// Of more matches, a pair that a maximum contains starts no search of its own.
constexpr std::size_t kManyMatches = 15;

// Bodies that are looked for together.
constexpr std::size_t kMaxBodies = 6;

class ExplanationSearch {
 public:
  explicit ExplanationSearch(const AlignmentEvidence& evidence)
      : e_(evidence), rigid_(evidence), many_(evidence.matches().size() > kManyMatches) {}

  std::vector<Hypothesis> Find() {
    Climb();
    Expand();
    KeepLikeliestMaxima();
    std::vector<Hypothesis> found = {NothingStayed()};
    for (const auto& [stayed, score] : scores_) {
      found.push_back({stayed, score.fit, score.log_score, 0.0});
    }
    const double first = Best();
    for (Hypothesis& hypothesis : found) {
      if (!hypothesis.stayed.empty()) {
        const bool maximum = std::binary_search(maxima_.begin(), maxima_.end(), hypothesis.stayed);
        const double singly = hypothesis.log_score - e_.LogStaying(hypothesis.stayed.Count());
        const bool is_likely = maximum || hypothesis.log_score > first - kWindow;
        hypothesis.log_score =
            singly + (is_likely ? LogBodies({hypothesis.stayed,
                                             &hypothesis.fit,
                                             scores_.at(hypothesis.stayed).log_moved})
                                : rigid_.LogStaying(hypothesis.stayed, {}));
      }
    }
    NormalizeAndSort(&found);
    return found;
  }

 private:
  const SetScore& Score(const MatchSet& stayed) {
    const auto found = scores_.find(stayed);
    if (found != scores_.end()) return found->second;
    return scores_.emplace(stayed, e_.Score(stayed)).first->second;
  }

  const SetScore& ScoreWithGains(const MatchSet& stayed, IndexedVector<MatchIndex, double>* gains) {
    SetScore score = e_.Score(stayed, gains);
    return scores_.insert_or_assign(stayed, std::move(score)).first->second;
  }

  double Best() const {
    double best = kLogZero;
    for (const auto& [stayed, score] : scores_) best = std::max(best, score.log_score);
    return best;
  }

  bool Agree(MatchIndex j, MatchIndex k) const {
    const double a = (e_.PositionInReference(j) - e_.PositionInReference(k)).norm();
    const double b = (e_.PositionInOther(j) - e_.PositionInOther(k)).norm();
    const double variance =
        2.0 * (e_.Variance(j) + e_.Variance(k)) + std::pow(e_.prior().sd_scale * a, 2);
    return (a - b) * (a - b) <= kPairGate * kPairGate * variance;
  }

  void Climb() {
    const MatchIndex end = e_.matches().end_index();
    for (MatchIndex j = 0; j < end; ++j) {
      for (MatchIndex k = j + 1; k < end; ++k) {
        const MatchSet pair = MatchSet::Of(j).Flipped(k);
        if (e_.Rivals(j).Contains(k) || !Agree(j, k)) continue;
        const bool inside = std::any_of(
            maxima_.begin(), maxima_.end(), [&](const MatchSet& s) { return s.Includes(pair); });
        if (!many_ || !inside) ClimbFrom(pair);
      }
    }
  }

  // Changes what gains most until nothing does.
  void ClimbFrom(MatchSet stayed) {
    constexpr double kPlainly = 2.0;  // [nats]
    constexpr int kLargeSet = 4;
    IndexedVector<MatchIndex, double> gains;
    while (climbed_.insert(stayed).second) {
      const double score = ScoreWithGains(stayed, &gains).log_score;
      const auto best = std::max_element(gains.begin(), gains.end());
      if (*best <= 0.0) break;
      const MatchSet one = stayed.Flipped(MatchIndex(best - gains.begin()));
      MatchSet next = one;
      const bool several = many_ && stayed.Count() >= kLargeSet;
      for (const MatchIndex k : gains.indices()) {
        if (!several || next.Intersects(e_.Rivals(k))) continue;
        if (gains[k] > kPlainly) next = next.Flipped(k);
      }
      if (Score(next).log_score <= score) next = one;
      if (Score(next).log_score <= score) break;
      stayed = next;
    }
    maxima_.push_back(stayed);
  }

  // Leaves each maximum once, sorted. The search for bodies compares each with all others.
  void KeepLikeliestMaxima() {
    constexpr std::size_t kMost = 500;  // Time grows with the square.
    std::sort(maxima_.begin(), maxima_.end());
    maxima_.erase(std::unique(maxima_.begin(), maxima_.end()), maxima_.end());
    if (maxima_.size() <= kMost) return;
    std::stable_sort(maxima_.begin(), maxima_.end(), [&](const MatchSet& x, const MatchSet& y) {
      return Score(x).log_score > Score(y).log_score;
    });
    maxima_.resize(kMost);
    std::sort(maxima_.begin(), maxima_.end());
  }

  void Expand() {
    std::priority_queue<std::pair<double, MatchSet>> queue;
    std::unordered_set<MatchSet> queued;
    double best = kLogZero;
    const auto add = [&](const MatchSet& stayed) {
      const double score = Score(stayed).log_score;
      best = std::max(best, score);
      queue.emplace(score, stayed);
    };
    for (const MatchSet& stayed : maxima_) {
      if (queued.insert(stayed).second) add(stayed);
    }
    IndexedVector<MatchIndex, double> gains;
    for (int i = 0; i < kMaxSetsExpanded && !queue.empty(); ++i) {
      const auto [score, stayed] = queue.top();
      queue.pop();
      if (score < best - kWindow) return;
      ScoreWithGains(stayed, &gains);
      for (const MatchIndex k : gains.indices()) {
        const MatchSet next = stayed.Flipped(k);
        const double expected = score + gains[k];
        if (next.Count() < 2 || !(expected > best - kWindow - 1.0)) continue;
        if (queued.insert(next).second) add(next);
      }
    }
  }

  // All matches that some rule out, and these.
  MatchSet RivalsOf(const MatchSet& matches) const {
    MatchSet rivals;
    for (const MatchIndex k : matches.Members()) rivals = rivals | e_.Rivals(k);
    return rivals;
  }

  // Sets that agree and have no landmark of `taken`, without those whose landmarks are far likelier
  // to have moved each alone. A set gains more than its subsets, yet two of these may be the bodies
  // that moved: the best gain is no limit for the others.
  const std::vector<Body>& BodiesBeside(const MatchSet& taken) {
    constexpr double kLeastGain = -20.0;  // [nats]
    const auto known = bodies_.find(taken);
    if (known != bodies_.end()) return known->second;
    std::vector<std::pair<double, Body>> rated;  // By what they gain against each landmark alone.
    std::unordered_set<MatchSet> tried;
    const MatchSet ruled_out = RivalsOf(taken);
    const auto add = [&](const MatchSet& together) {
      const int count = together.Count();
      if (count < RigidBodies::kMinSize || !tried.insert(together).second) return;
      const SetScore& score = Score(together);
      const double gain =
          score.log_evidence + rigid_.LogProbability(together) - count * e_.log_anywhere();
      if (!std::isfinite(gain)) return;
      rated.push_back(
          {gain, {together, score.fit, score.log_evidence, rigid_.ScatteredShare(together)}});
    };
    for (const MatchSet& maximum : maxima_) {
      const MatchSet agreeing = maximum.Without(ruled_out);
      add(agreeing);
      MatchSet beside = agreeing;
      for (const MatchSet& cluster : rigid_.clusters()) {
        add(agreeing & cluster);
        beside = beside.Without(cluster);
      }
      add(beside);
    }
    std::sort(rated.begin(), rated.end(), [](const auto& x, const auto& y) {
      return x.first != y.first ? x.first > y.first : x.second.matches < y.second.matches;
    });
    std::vector<Body> bodies;
    for (const auto& [gain, body] : rated) {
      if (gain < kLeastGain) break;
      bodies.push_back(body);
    }
    return bodies_.emplace(taken, std::move(bodies)).first->second;
  }

  // log of the prior that just these stayed, with how much likelier it makes the positions of the
  // others that some of them moved as bodies: none or several. Beside all but the likeliest no
  // further one is looked for.
  double LogBodies(const StayedLandmarks& stayed) {
    constexpr double kRejected = 12.0;  // [nats]
    MovedBodies moved(e_, rigid_, stayed);
    MatchSet taken = stayed.matches;
    double present = moved.LogScore();
    double total = present;
    if (e_.prior().group_share <= 0.0) return total;
    while (moved.matches().size() < kMaxBodies) {
      double best = kLogZero;
      std::optional<MovedBodies> likeliest;
      for (const Body& body : BodiesBeside(taken)) {
        MovedBodies more = moved.With(body);
        const double log_score = more.LogScore();
        total = LogAdd(total, log_score);
        if (log_score <= best) continue;
        best = log_score;
        likeliest = std::move(more);
      }
      // Of two that changed places the first alone is not likely yet.
      const bool first = moved.matches().empty();
      if (best < present - (first ? kRejected : 0.0)) break;
      moved = *std::move(likeliest);
      present = best;
      taken = taken | moved.matches().back();
    }
    return total;
  }

  // Fewer than two landmarks stayed: all are anywhere, or near where they were under some
  // transform, or some moved together.
  Hypothesis NothingStayed() {
    const double near = LogAllMovedSomeNear(e_, LikeliestFits()) + rigid_.LogAllMoved({});
    StayedLandmarks none;
    none.log_moved.assign(e_.groups().size(), e_.log_anywhere());
    const double bodies = e_.LogAllAnywhere() + LogBodies(none);
    Hypothesis nothing;
    nothing.log_score = LogAdd(near, bodies) + std::log(e_.prior().none_stayed);
    return nothing;
  }

  std::vector<SimilarityFit> LikeliestFits() {
    constexpr std::size_t kMost = 8;  // Each is searched from anew.
    std::vector<std::pair<double, MatchSet>> by_score;
    for (const MatchSet& maximum : maxima_) {
      by_score.emplace_back(-Score(maximum).log_score, maximum);
    }
    std::sort(by_score.begin(), by_score.end());
    if (by_score.size() > kMost) by_score.resize(kMost);
    std::vector<SimilarityFit> fits;
    for (const auto& [score, maximum] : by_score) fits.push_back(Score(maximum).fit);
    return fits;
  }

  const AlignmentEvidence& e_;
  RigidBodies rigid_;
  bool many_;                            // Matches.
  std::map<MatchSet, SetScore> scores_;  // In the order of sets: sums do not depend on the search.
  std::unordered_set<MatchSet> climbed_;
  std::vector<MatchSet> maxima_;
  std::map<MatchSet, std::vector<Body>> bodies_;  // By the matches that they do not contain.
};

}  // namespace

void NormalizeAndSort(std::vector<Hypothesis>* hypotheses) {
  double total = kLogZero;
  for (const Hypothesis& hypothesis : *hypotheses) total = LogAdd(total, hypothesis.log_score);
  for (Hypothesis& hypothesis : *hypotheses) {
    hypothesis.probability = std::exp(hypothesis.log_score - total);
  }
  std::sort(hypotheses->begin(), hypotheses->end(), [](const Hypothesis& x, const Hypothesis& y) {
    return x.probability != y.probability ? x.probability > y.probability : x.stayed < y.stayed;
  });
}

std::vector<Hypothesis> SearchHypotheses(const AlignmentEvidence& evidence) {
  return ExplanationSearch(evidence).Find();
}

}  // namespace shiftmap

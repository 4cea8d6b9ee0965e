// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/explanation_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <queue>
#include <unordered_set>
#include <utility>

#include "mapper/alignment/all_moved.h"

namespace shiftmap {
namespace {

constexpr double kNever = -std::numeric_limits<double>::infinity();
constexpr double kTwoPi = 2.0 * std::numbers::pi;

// Fewer do not show that they moved together: any two landmarks and any transform agree.
constexpr int kMinTogether = 3;

// Of two landmarks that stayed the distances agree to this, in standard deviations.
constexpr double kPairGate = 4.0;

// Bodies that move go on facing about the same way in half of all cases. [rad]
constexpr double kSameHeadingSd = 0.2;

// Of more matches, a pair that a maximum contains starts no search of its own.
constexpr int kManyMatches = 15;

// Landmarks that agree and may have moved together.
struct Body {
  MatchSet matches;
  SimilarityFit fit;
  double log_density = 0.0;       // Of the prior and all positions, were it anywhere.
  double against_anywhere = 0.0;  // The same, against each landmark anywhere by itself.
};

class Search {
 public:
  Search(const AlignmentEvidence& evidence, const MovePrior& prior, const ExplanationLimits& limits)
      : e_(evidence),
        prior_(prior),
        limits_(limits),
        matches_(static_cast<int>(evidence.matches().size())),
        landmarks_(static_cast<int>(evidence.groups().size())) {}

  std::vector<Hypothesis> Find() {
    Climb();
    Expand();
    KeepLikeliestMaxima();
    std::vector<Hypothesis> found = {NothingStayed()};
    for (const auto& [stayed, score] : scores_) {
      found.push_back({stayed, {}, score.fit, score.log_score, 0.0});
    }
    const double first = Best();
    double total = kNever;
    for (Hypothesis& hypothesis : found) {
      const bool maximum = std::binary_search(maxima_.begin(), maxima_.end(), hypothesis.stayed);
      if (!hypothesis.stayed.empty() &&
          (maximum || hypothesis.log_score > first - limits_.window)) {
        hypothesis.log_score += LogBodies(hypothesis.stayed,
                                          &hypothesis.fit,
                                          scores_.at(hypothesis.stayed).log_moved,
                                          &hypothesis.together);
      }
      total = LogSum(total, hypothesis.log_score);
    }
    for (Hypothesis& hypothesis : found) {
      hypothesis.probability = std::exp(hypothesis.log_score - total);
    }
    std::sort(found.begin(), found.end(), [](const Hypothesis& x, const Hypothesis& y) {
      return x.probability != y.probability ? x.probability > y.probability : x.stayed < y.stayed;
    });
    return found;
  }

 private:
  const SetScore& Score(const MatchSet& stayed) {
    const auto found = scores_.find(stayed);
    if (found != scores_.end()) return found->second;
    return scores_.emplace(stayed, e_.Score(stayed)).first->second;
  }

  const SetScore& ScoreWithGains(const MatchSet& stayed, std::vector<double>* gains) {
    SetScore score = e_.Score(stayed, gains);
    return scores_.insert_or_assign(stayed, std::move(score)).first->second;
  }

  double Best() const {
    double best = kNever;
    for (const auto& [stayed, score] : scores_) best = std::max(best, score.log_score);
    return best;
  }

  bool Agree(int j, int k) const {
    const double a = (e_.PositionInReference(j) - e_.PositionInReference(k)).norm();
    const double b = (e_.PositionInOther(j) - e_.PositionInOther(k)).norm();
    const double variance =
        2.0 * (e_.Variance(j) + e_.Variance(k)) + std::pow(prior_.sd_scale * a, 2);
    return (a - b) * (a - b) <= kPairGate * kPairGate * variance;
  }

  void Climb() {
    for (int j = 0; j < matches_; ++j) {
      for (int k = j + 1; k < matches_; ++k) {
        const MatchSet pair = MatchSet::Of(j).Flipped(k);
        if (e_.Rivals(j).Contains(k) || !Agree(j, k)) continue;
        const bool inside = std::any_of(
            maxima_.begin(), maxima_.end(), [&](const MatchSet& s) { return s.Includes(pair); });
        if (matches_ <= kManyMatches || !inside) ClimbFrom(pair);
      }
    }
  }

  // Changes what gains most until nothing does.
  void ClimbFrom(MatchSet stayed) {
    constexpr double kPlainly = 2.0;  // [nats]
    constexpr int kLargeSet = 4;
    std::vector<double> gains;
    while (climbed_.insert(stayed).second) {
      const double score = ScoreWithGains(stayed, &gains).log_score;
      const auto best = std::max_element(gains.begin(), gains.end());
      if (*best <= 0.0) break;
      const MatchSet one = stayed.Flipped(static_cast<int>(best - gains.begin()));
      MatchSet next = one;
      const bool several = matches_ > kManyMatches && stayed.Count() >= kLargeSet;
      for (int k = 0; several && k < matches_; ++k) {
        if (next.Intersects(e_.Rivals(k))) continue;
        if (gains[static_cast<std::size_t>(k)] > kPlainly) next = next.Flipped(k);
      }
      if (Score(next).log_score <= score) next = one;
      if (Score(next).log_score <= score) break;
      stayed = next;
    }
    maxima_.push_back(stayed);
  }

  // Leaves each maximum once, sorted. The search for bodies compares each with all others.
  void KeepLikeliestMaxima() {
    constexpr std::size_t kMost = 500;
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
    double best = kNever;
    const auto add = [&](const MatchSet& stayed) {
      const double score = Score(stayed).log_score;
      best = std::max(best, score);
      queue.emplace(score, stayed);
    };
    for (const MatchSet& stayed : maxima_) {
      if (queued.insert(stayed).second) add(stayed);
    }
    std::vector<double> gains;
    for (int i = 0; i < limits_.max_expanded && !queue.empty(); ++i) {
      const auto [score, stayed] = queue.top();
      queue.pop();
      if (score < best - limits_.window) return;
      ScoreWithGains(stayed, &gains);
      for (int k = 0; k < matches_; ++k) {
        const MatchSet next = stayed.Flipped(k);
        const double expected = score + gains[static_cast<std::size_t>(k)];
        if (next.Count() < 2 || !(expected > best - limits_.window - 1.0)) continue;
        if (queued.insert(next).second) add(next);
      }
    }
  }

  // Just these landmarks moved together, each from any of its modes. A body is compact: it has a
  // landmark as its centre, takes in the nearest ones, and most of these go along.
  double LogTogether(const MatchSet& together) const {
    double log_modes = 0.0;
    double radius = std::numeric_limits<double>::infinity();
    int centre = 0;
    const std::vector<int> members = together.Members();
    for (const int c : members) {
      log_modes += std::log(static_cast<double>(e_.ModesOf(c)));
      double reach = 0.0;
      for (const int k : members) reach = std::max(reach, DistanceInReference(c, k));
      if (reach < radius) {
        radius = reach;
        centre = c;
      }
    }
    const auto count = static_cast<int>(members.size());
    double others = 0.0;  // Within reach; those of several modes by as many as are.
    for (int k = 0; k < matches_; ++k) {
      if (together.Intersects(e_.Rivals(k)) || DistanceInReference(centre, k) > radius) continue;
      others += 1.0 / e_.ModesOf(k);
    }
    return -std::log(static_cast<double>(landmarks_)) +
           (count + others - kMinTogether) * std::log(prior_.group_continue) +
           std::log1p(-prior_.group_continue) + count * std::log(prior_.group_along) +
           others * std::log1p(-prior_.group_along) - log_modes;
  }

  double DistanceInReference(int j, int k) const {
    return (e_.PositionInReference(j) - e_.PositionInReference(k)).norm();
  }

  // All matches that some rule out, and these.
  MatchSet RivalsOf(const MatchSet& matches) const {
    MatchSet rivals;
    for (const int k : matches.Members()) rivals = rivals | e_.Rivals(k);
    return rivals;
  }

  // log density of where a body went, against anywhere in the area and any heading.
  double LogWent(const SimilarityFit& body, const SimilarityFit& map) const {
    constexpr double kNoVariance = 1e-4;  // [m²]
    const double turn = std::remainder(body.yaw_rad - map.yaw_rad, kTwoPi);
    const double same_heading =
        std::exp(-0.5 * std::pow(turn / kSameHeadingSd, 2)) * std::sqrt(kTwoPi) / kSameHeadingSd;
    return e_.LogMovedBy(body.centre_other - map * body.centre_reference,
                         kNoVariance * Eigen::Matrix2d::Identity()) +
           e_.log_area() + std::log(0.5 + 0.5 * same_heading);
  }

  // Sets that agree and leave out the landmarks of `taken`, the most telling ones.
  const std::vector<Body>& BodiesBeside(const MatchSet& taken) {
    constexpr double kWindow = 20.0;  // [nats]
    const auto known = bodies_.find(taken);
    if (known != bodies_.end()) return known->second;
    std::vector<Body> bodies;
    std::unordered_set<MatchSet> tried;
    const MatchSet ruled_out = RivalsOf(taken);
    for (const MatchSet& maximum : maxima_) {
      const MatchSet together = maximum.Without(ruled_out);
      const int count = together.Count();
      if (count < kMinTogether || !tried.insert(together).second) continue;
      const SetScore& score = Score(together);
      const double log_density =
          score.log_evidence + LogTogether(together) + std::log(prior_.group_share);
      if (!std::isfinite(log_density)) continue;
      bodies.push_back({together, score.fit, log_density, log_density - count * e_.log_anywhere()});
    }
    std::sort(bodies.begin(), bodies.end(), [](const Body& x, const Body& y) {
      return x.against_anywhere != y.against_anywhere ? x.against_anywhere > y.against_anywhere
                                                      : x.matches < y.matches;
    });
    bodies.erase(std::find_if(bodies.begin(),
                              bodies.end(),
                              [&](const Body& body) {
                                return body.against_anywhere <
                                       bodies.front().against_anywhere - kWindow;
                              }),
                 bodies.end());
    return bodies_.emplace(taken, std::move(bodies)).first->second;
  }

  // log of how much likelier it makes the landmarks that are not in `taken` that some of them moved
  // as bodies: none or several, each further one as probable as the first. Beside all but the
  // likeliest no further one is looked for.
  // @param map        The transform of what stayed; null if it does not tell where bodies moved.
  // @param log_moved  Per landmark the log density of its position if it moved by itself.
  // @param together   The likeliest body if that is likelier than none. May be null.
  double LogBodies(const MatchSet& taken,
                   const SimilarityFit* map,
                   const std::vector<double>& log_moved,
                   MatchSet* together) {
    if (prior_.group_share <= 0.0) return 0.0;
    const double log_no_more = std::log1p(-prior_.group_share);
    double others = kNever;
    double best = kNever;
    MatchSet best_matches;
    for (const Body& body : BodiesBeside(taken)) {
      double gain = body.log_density + (map == nullptr ? 0.0 : LogWent(body.fit, *map));
      for (const int k : body.matches.Members()) {
        gain -= log_moved[static_cast<std::size_t>(e_.LandmarkOf(k))];
      }
      others = LogSum(others, std::min(best, gain));
      if (gain <= best) continue;
      best = gain;
      best_matches = body.matches;
    }
    if (best <= 0.0) return LogSum(log_no_more, log_no_more + LogSum(others, best));
    if (together != nullptr) *together = best_matches;
    const double more = LogBodies(taken | best_matches, map, log_moved, nullptr);
    return LogSum(LogSum(log_no_more, log_no_more + others), best + more);
  }

  // Fewer than two landmarks stayed: all are anywhere, or near where they were under some
  // transform, or some moved together.
  Hypothesis NothingStayed() {
    const double near =
        LogAllMovedSomeNear(e_, prior_, LikeliestFits()) + std::log1p(-prior_.group_share);
    const std::vector<double> anywhere(static_cast<std::size_t>(landmarks_), e_.log_anywhere());
    const double bodies =
        landmarks_ * e_.log_anywhere() + LogBodies({}, nullptr, anywhere, nullptr);
    Hypothesis nothing;
    nothing.log_score = LogSum(near, bodies) + std::log(prior_.none_stayed);
    return nothing;
  }

  std::vector<SimilarityFit> LikeliestFits() {
    constexpr std::size_t kMost = 8;
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
  const MovePrior& prior_;
  const ExplanationLimits& limits_;
  int matches_;
  int landmarks_;
  std::map<MatchSet, SetScore> scores_;  // In the order of sets: sums do not depend on the search.
  std::unordered_set<MatchSet> climbed_;
  std::vector<MatchSet> maxima_;
  std::map<MatchSet, std::vector<Body>> bodies_;  // By the matches that they do not contain.
};

}  // namespace

std::vector<Hypothesis> SearchHypotheses(const AlignmentEvidence& evidence,
                                         const MovePrior& prior,
                                         const ExplanationLimits& limits) {
  return Search(evidence, prior, limits).Find();
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/explanation_search.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <queue>
#include <random>
#include <unordered_set>
#include <utility>

#include "mapstore/geometry/se2.h"

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

MatchSet Bit(int match) { return MatchSet{1} << match; }

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
    std::sort(maxima_.begin(), maxima_.end());
    maxima_.erase(std::unique(maxima_.begin(), maxima_.end()), maxima_.end());
    std::vector<Hypothesis> found = {NothingStayed()};
    for (const auto& [stayed, score] : scores_) {
      found.push_back({stayed, 0, score.fit, score.log_score, 0.0});
    }
    const double first = Best();
    double total = kNever;
    for (Hypothesis& hypothesis : found) {
      const bool maximum = std::binary_search(maxima_.begin(), maxima_.end(), hypothesis.stayed);
      if (hypothesis.stayed != 0 && (maximum || hypothesis.log_score > first - limits_.window)) {
        MoveTogether(&hypothesis);
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
  const SetScore& Score(MatchSet stayed) {
    const auto found = scores_.find(stayed);
    if (found != scores_.end()) return found->second;
    return scores_.emplace(stayed, e_.Score(stayed)).first->second;
  }

  const SetScore& ScoreWithGains(MatchSet stayed, std::vector<double>* gains) {
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
        const MatchSet pair = Bit(j) | Bit(k);
        if ((e_.Rivals(j) & Bit(k)) != 0 || !Agree(j, k)) continue;
        const bool inside = std::any_of(
            maxima_.begin(), maxima_.end(), [&](MatchSet s) { return (s & pair) == pair; });
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
      const MatchSet one = stayed ^ Bit(static_cast<int>(best - gains.begin()));
      MatchSet next = one;
      for (int k = 0; matches_ > kManyMatches && k < matches_; ++k) {
        if (std::popcount(stayed) < kLargeSet || (next & e_.Rivals(k)) != 0) continue;
        if (gains[static_cast<std::size_t>(k)] > kPlainly) next |= Bit(k);
      }
      if (Score(next).log_score <= score) next = one;
      if (Score(next).log_score <= score) break;
      stayed = next;
    }
    maxima_.push_back(stayed);
  }

  void Expand() {
    std::priority_queue<std::pair<double, MatchSet>> queue;
    std::unordered_set<MatchSet> queued;
    double best = kNever;
    const auto add = [&](MatchSet stayed) {
      const double score = Score(stayed).log_score;
      best = std::max(best, score);
      queue.emplace(score, stayed);
    };
    for (const MatchSet stayed : maxima_) {
      if (queued.insert(stayed).second) add(stayed);
    }
    std::vector<double> gains;
    for (int i = 0; i < limits_.max_expanded && !queue.empty(); ++i) {
      const auto [score, stayed] = queue.top();
      queue.pop();
      if (score < best - limits_.window) return;
      ScoreWithGains(stayed, &gains);
      for (int k = 0; k < matches_; ++k) {
        const MatchSet next = stayed ^ Bit(k);
        const double expected = score + gains[static_cast<std::size_t>(k)];
        if (std::popcount(next) < 2 || !(expected > best - limits_.window - 1.0)) continue;
        if (queued.insert(next).second) add(next);
      }
    }
  }

  // Just these landmarks moved together, each from any of its modes. A body is compact: it has a
  // landmark as its centre, takes in the nearest ones, and most of these go along.
  double LogTogether(MatchSet together) const {
    double log_modes = 0.0;
    double radius = std::numeric_limits<double>::infinity();
    int centre = 0;
    for (int c = 0; c < matches_; ++c) {
      if ((together & Bit(c)) == 0) continue;
      log_modes += std::log(static_cast<double>(std::popcount(e_.Rivals(c))));
      double reach = 0.0;
      for (int k = 0; k < matches_; ++k) {
        if ((together & Bit(k)) != 0) reach = std::max(reach, DistanceInReference(c, k));
      }
      if (reach < radius) {
        radius = reach;
        centre = c;
      }
    }
    const int count = std::popcount(together);
    double others = 0.0;  // Within reach; those of several modes by as many as are.
    for (int k = 0; k < matches_; ++k) {
      if ((together & e_.Rivals(k)) != 0 || DistanceInReference(centre, k) > radius) continue;
      others += 1.0 / std::popcount(e_.Rivals(k));
    }
    return -std::log(static_cast<double>(landmarks_)) +
           (count + others - kMinTogether) * std::log(prior_.group_continue) +
           std::log1p(-prior_.group_continue) + count * std::log(prior_.group_along) +
           others * std::log1p(-prior_.group_along) - log_modes;
  }

  double DistanceInReference(int j, int k) const {
    return (e_.PositionInReference(j) - e_.PositionInReference(k)).norm();
  }

  MatchSet Without(MatchSet set, MatchSet stayed) const {
    for (int k = 0; k < matches_; ++k) {
      if ((stayed & Bit(k)) != 0) set &= ~e_.Rivals(k);
    }
    return set;
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

  // Adds that some of the landmarks that moved did so together, over sets that agree.
  void MoveTogether(Hypothesis* hypothesis) {
    if (prior_.group_share <= 0.0) return;
    const std::vector<double> log_moved = Score(hypothesis->stayed).log_moved;
    std::unordered_set<MatchSet> tried;
    double total = kNever;
    double best = 0.0;
    for (const MatchSet maximum : maxima_) {
      const MatchSet together = Without(maximum, hypothesis->stayed);
      if (std::popcount(together) < kMinTogether || !tried.insert(together).second) continue;
      const SetScore& body = Score(together);
      double gain = body.log_evidence + LogTogether(together) + LogWent(body.fit, hypothesis->fit);
      for (int k = 0; k < matches_; ++k) {
        if ((together & Bit(k)) == 0) continue;
        gain -=
            log_moved[static_cast<std::size_t>(e_.matches()[static_cast<std::size_t>(k)].landmark)];
      }
      gain += std::log(prior_.group_share);
      total = LogSum(total, gain);
      if (gain <= best) continue;
      best = gain;
      hypothesis->together = together;
    }
    hypothesis->log_score += LogSum(std::log1p(-prior_.group_share), total);
  }

  // Fewer than two landmarks stayed: all are anywhere, or near where they were under some
  // transform, or some moved together.
  Hypothesis NothingStayed() {
    double together = kNever;
    for (const MatchSet maximum : maxima_) {
      const int count = std::popcount(maximum);
      if (count < kMinTogether || prior_.group_share <= 0.0) continue;
      together =
          LogSum(together,
                 Score(maximum).log_evidence + LogTogether(maximum) +
                     (landmarks_ - count) * e_.log_anywhere() + std::log(prior_.group_share));
    }
    Hypothesis nothing;
    nothing.log_score = LogSum(LogAllMoved(), together) + std::log(prior_.none_stayed);
    return nothing;
  }

  // A Gaussian over rigid transforms: (centre_other, yaw_rad) of `fit`.
  struct Proposal {
    SimilarityFit fit;
    Eigen::LLT<Eigen::Matrix3d> information;

    double LogDensity(const Eigen::Vector3d& offset) const {
      const Eigen::Vector3d z = information.matrixU() * offset;
      return -0.5 * z.squaredNorm() - 1.5 * std::log(kTwoPi) +
             information.matrixLLT().diagonal().array().log().sum();
    }
  };

  // log of the integral over rigid transforms, uniform over the area and all headings, that all
  // landmarks moved: importance sampling from Gaussians around where most moved little.
  double LogAllMoved() {
    constexpr std::size_t kStarts = 8;
    constexpr int kDraws = 64;  // Of each.
    std::vector<std::pair<double, MatchSet>> starts;
    for (const MatchSet maximum : maxima_) starts.emplace_back(-Score(maximum).log_score, maximum);
    std::sort(starts.begin(), starts.end());
    if (starts.size() > kStarts) starts.resize(kStarts);
    if (starts.empty()) return landmarks_ * e_.log_anywhere();
    std::vector<Proposal> proposals;
    for (const auto& [score, start] : starts)
      proposals.push_back(AroundLeastMoves(Score(start).fit));
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    double total = kNever;
    for (const Proposal& proposal : proposals) {
      for (int i = 0; i < kDraws; ++i) {
        const Eigen::Vector3d z(normal(random), normal(random), normal(random));
        const Eigen::Vector3d step = proposal.information.matrixU().solve(z);
        SimilarityFit x = proposal.fit;
        x.centre_other += step.head<2>();
        x.yaw_rad += step[2];
        double log_density = -e_.log_area() - std::log(kTwoPi);
        for (int landmark = 0; landmark < landmarks_; ++landmark) {
          log_density += LogMoved(landmark, x);
        }
        double log_proposal = kNever;
        for (const Proposal& other : proposals) {
          Eigen::Vector3d offset;
          offset << x * other.fit.centre_reference - other.fit.centre_other,
              std::remainder(x.yaw_rad - other.fit.yaw_rad, kTwoPi);
          log_proposal = LogSum(log_proposal, other.LogDensity(offset));
        }
        // Each has as many draws: of their mixture.
        total = LogSum(total, log_density - log_proposal + std::log(std::ssize(proposals)));
      }
    }
    return LogSum(total - std::log(static_cast<double>(kDraws * proposals.size())),
                  landmarks_ * e_.log_anywhere());
  }

  // Expectation and maximization over how far each landmark moved, from a start; the Gaussian there
  // is widened to reach what lies around.
  Proposal AroundLeastMoves(SimilarityFit fit) const {
    constexpr int kIterations = 12;
    constexpr double kWider = 2.0;
    fit.log_scale = 0.0;
    Eigen::Matrix3d information;
    for (int i = 0; i < kIterations; ++i) {
      information = 1e-6 * Eigen::Matrix3d::Identity();
      Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
      for (int landmark = 0; landmark < landmarks_; ++landmark) {
        AddNear(landmark, fit, &information, &gradient);
      }
      const Eigen::Vector3d step = information.llt().solve(gradient);
      fit.centre_other += step.head<2>();
      fit.yaw_rad += step[2];
    }
    return {fit, Eigen::LLT<Eigen::Matrix3d>(information / (kWider * kWider))};
  }

  // log density of a landmark that moved near or anywhere, from any of its modes.
  double LogMoved(int landmark, const SimilarityFit& fit) const {
    const auto [first, end] = e_.MatchesOf(landmark);
    double log_density = kNever;
    for (int k = first; k < end; ++k) {
      const Eigen::Vector2d r = e_.PositionInOther(k) - fit * e_.PositionInReference(k);
      log_density =
          LogSum(log_density, e_.LogMovedBy(r, e_.Variance(k) * Eigen::Matrix2d::Identity()));
    }
    return log_density - std::log(static_cast<double>(end - first));
  }

  // The same with Gaussian densities of near moves, which have one maximum.
  void AddNear(int landmark,
               const SimilarityFit& fit,
               Eigen::Matrix3d* information,
               Eigen::Vector3d* gradient) const {
    const std::pair<int, int> of_landmark = e_.MatchesOf(landmark);
    const int modes = of_landmark.second - of_landmark.first;
    const double log_each =
        std::log(prior_.near_share / static_cast<double>(prior_.near_sd_m.size()) / modes);
    double total = e_.log_anywhere();
    const auto visit_all = [&](const auto& visit) {
      for (int k = of_landmark.first; k < of_landmark.second; ++k) {
        const Eigen::Vector2d q = fit * e_.PositionInReference(k) - fit.centre_other;
        const Eigen::Vector2d r = e_.PositionInOther(k) - fit.centre_other - q;
        for (const double sd : prior_.near_sd_m) {
          const double variance = sd * sd + e_.Variance(k);
          visit(q,
                r,
                variance,
                log_each - 0.5 * r.squaredNorm() / variance - std::log(kTwoPi * variance));
        }
      }
    };
    visit_all([&](const auto&, const auto&, double, double log_density) {
      total = LogSum(total, log_density);
    });
    visit_all([&](const Eigen::Vector2d& q,
                  const Eigen::Vector2d& r,
                  double variance,
                  double log_density) {
      const double weight = std::exp(log_density - total) / variance;
      Eigen::Matrix<double, 2, 3> jacobian;
      jacobian << 1.0, 0.0, -q.y(), 0.0, 1.0, q.x();
      *information += weight * jacobian.transpose() * jacobian;
      *gradient += weight * jacobian.transpose() * r;
    });
  }

  const AlignmentEvidence& e_;
  const MovePrior& prior_;
  const ExplanationLimits& limits_;
  int matches_;
  int landmarks_;
  std::map<MatchSet, SetScore> scores_;  // In the order of sets: sums do not depend on the search.
  std::unordered_set<MatchSet> climbed_;
  std::vector<MatchSet> maxima_;
};

}  // namespace

std::vector<Hypothesis> SearchHypotheses(const AlignmentEvidence& evidence,
                                         const MovePrior& prior,
                                         const ExplanationLimits& limits) {
  return Search(evidence, prior, limits).Find();
}

}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/consensus.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <utility>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Up to as many pairs of correspondences, all are tried.
constexpr double kMaxAllPairs = 5000.0;

// Probability that draws of pairs miss a transform that matters.
constexpr double kMissed = 1e-9;

// The landmarks that agree must determine the rotation to this standard deviation, and to three
// times as much without any one of them. Three signs on one post determine no rotation, and a wrong
// one together with a landmark that agrees by accident. [rad]
constexpr double kMaxSdRotationRad = 0.1;
constexpr double kWithoutOne = 3.0;

struct Correspondence {
  LandmarkIndex group;  // Of those that both frames have.
  Eigen::Vector2d reference;
  Eigen::Vector2d other;
  double variance = 0.0;    // Per axis, both sides and the floor. [m²]
  double log_rarity = 0.0;  // log(A / 2πσ²), what agreement counts before its distance.
};

// reference = centroid_reference + scale R (other - centroid_other).
struct Similarity {
  Eigen::Vector2d centroid_reference = Eigen::Vector2d::Zero();
  Eigen::Vector2d centroid_other = Eigen::Vector2d::Zero();
  double yaw = 0.0;
  Eigen::Matrix2d R = Eigen::Matrix2d::Identity();  // By yaw.
  double scale = 1.0;
  double variance = 0.0;  // Of the centroid. [m²]
  double spread = 0.0;    // Σ weight |other - centroid|². [-]

  Eigen::Vector2d operator*(const Eigen::Vector2d& other) const {
    const Eigen::Vector2d offset = other - centroid_other;
    return centroid_reference + scale * (R * offset);
  }

  Se2 Rigid() const {
    const Eigen::Vector2d translation = centroid_reference - R * centroid_other;
    return Se2(translation, yaw);
  }
};

struct Candidate {
  Similarity fit;
  IndexedVector<LandmarkIndex, std::optional<MatchIndex>> support;  // Per group its best match.
  int count = 0;                                                    // Groups that have one.
  double score = 0.0;  // Log-likelihood ratio to "every landmark stands anywhere".
};

// Finds the transform between two frames from the correspondences of their points.
class Consensus {
 public:
  Consensus(const AlignmentPoints& reference,
            const AlignmentPoints& other,
            double area,
            const AlignmentOptions& options)
      : options_(options), gate_(ChiSquareQuantile(options.gate_probability, 2)) {
    AddMatches(reference, other, area);
    squared_.resize(groups_.size());
    best_.support.resize(groups_.size());
  }

  std::optional<Alignment> Find() {
    const auto count = static_cast<int>(matches_.size());
    if (count < options_.min_signatures) return std::nullopt;
    if (0.5 * count * (count - 1) <= std::min(kMaxAllPairs, 1.0 * options_.max_pairs)) {
      for (const MatchIndex i : matches_.indices()) {
        for (MatchIndex j = i + 1; j < matches_.end_index(); ++j) Propose(i, j);
      }
    } else {
      std::mt19937_64 random(1);
      std::uniform_int_distribution<int> pick(0, count - 1);
      for (int k = 0; k < options_.max_pairs && k < SufficientDraws(); ++k) {
        const MatchIndex first(pick(random));
        Propose(first, MatchIndex(pick(random)));
      }
    }
    if (best_.count == 0) return std::nullopt;
    return Describe();
  }

 private:
  // After so many draws a transform that half as many groups support as the best, or the fewest
  // that count, has been proposed but with probability kMissed: each draws a pair of its
  // supporters, two that differ, with probability supporters (supporters - 1) / matches².
  double SufficientDraws() const {
    const double supporters = std::max(1.0 * options_.min_signatures, 0.5 * best_.count);
    const auto matches = static_cast<double>(matches_.size());
    return std::log(kMissed) / std::log1p(-supporters * (supporters - 1.0) / (matches * matches));
  }

  void AddMatches(const AlignmentPoints& reference, const AlignmentPoints& other, double area) {
    const double floor = 2.0 * options_.position_floor_m * options_.position_floor_m;
    for (const auto& [group, i, j] : CandidateMatches(reference, other)) {
      const AlignmentPoint& known = reference[i];
      const AlignmentPoint& point = other[j];
      if (groups_.empty() || groups_.back() != group) groups_.push_back(group);
      const double variance = 0.5 * (known.cov.trace() + point.cov.trace()) + floor;
      matches_.push_back({groups_.end_index() - 1,
                          known.position,
                          point.position,
                          variance,
                          std::log(area / (2.0 * std::numbers::pi * variance))});
    }
  }

  // Least squares over correspondences, weighted by inverse variance; closed form.
  // @param visit_all  Calls its argument with each of them.
  template <typename VisitAll>
  Similarity FitOver(const VisitAll& visit_all) const {
    Similarity fit;
    double weights = 0.0;
    visit_all([&](const Correspondence& match) {
      weights += 1.0 / match.variance;
      fit.centroid_reference += match.reference / match.variance;
      fit.centroid_other += match.other / match.variance;
    });
    fit.centroid_reference /= weights;
    fit.centroid_other /= weights;
    fit.variance = 1.0 / weights;
    double dot = 0.0;
    double cross = 0.0;
    visit_all([&](const Correspondence& match) {
      const Eigen::Vector2d a = match.other - fit.centroid_other;
      const Eigen::Vector2d b = match.reference - fit.centroid_reference;
      dot += a.dot(b) / match.variance;
      cross += (a.x() * b.y() - a.y() * b.x()) / match.variance;
      fit.spread += a.squaredNorm() / match.variance;
    });
    fit.yaw = std::atan2(cross, dot);
    fit.R = Se2(0.0, 0.0, fit.yaw).Rotation();
    if (fit.spread > 0.0) {
      fit.scale = std::clamp(std::hypot(cross, dot) / fit.spread,
                             1.0 - options_.max_scale_error,
                             1.0 + options_.max_scale_error);
    }
    return fit;
  }

  Similarity Fit(const Candidate& candidate) const {
    return FitOver([&](const auto& visit) {
      for (const auto& match : candidate.support) {
        if (match) visit(matches_[*match]);
      }
    });
  }

  Candidate Support(const Similarity& fit) {
    Candidate candidate{fit, {}};
    candidate.support.resize(groups_.size());
    for (const MatchIndex i : matches_.indices()) {
      const Correspondence& match = matches_[i];
      const double squared = (fit * match.other - match.reference).squaredNorm() / match.variance;
      if (squared > gate_) continue;
      std::optional<MatchIndex>& support = candidate.support[match.group];
      if (support && squared >= squared_[match.group]) continue;
      candidate.count += support ? 0 : 1;
      squared_[match.group] = squared;
      support = i;
    }
    for (const LandmarkIndex group : groups_.indices()) {
      const std::optional<MatchIndex> support = candidate.support[group];
      if (support) candidate.score += matches_[*support].log_rarity - 0.5 * squared_[group];
    }
    return candidate;
  }

  Candidate Refine(Candidate candidate) {
    constexpr int kMaxIterations = 10;
    for (int i = 0; i < kMaxIterations; ++i) {
      Candidate next = Support(Fit(candidate));
      if (next.score <= candidate.score) break;
      candidate = std::move(next);
    }
    return candidate;
  }

  bool SupportsBest(MatchIndex match) const {
    return best_.support[matches_[match].group] == match;
  }

  // The transform that two correspondences tell of.
  void Propose(MatchIndex i, MatchIndex j) {
    const Correspondence& a = matches_[i];
    const Correspondence& b = matches_[j];
    if (a.group == b.group) return;
    // Two that support the best transform so far propose nothing but that.
    if (SupportsBest(i) && SupportsBest(j)) return;
    const double length = (a.reference - b.reference).norm();
    const double slack = options_.max_scale_error * length;
    const double excess = std::max(0.0, std::abs(length - (a.other - b.other).norm()) - slack);
    if (excess * excess > gate_ * (a.variance + b.variance)) return;
    Candidate candidate = Support(FitOver([&](const auto& visit) {
      visit(a.group < b.group ? a : b);
      visit(a.group < b.group ? b : a);
    }));
    if (candidate.count < options_.min_signatures) return;
    candidate = Refine(std::move(candidate));
    if (candidate.score > best_.score && TellsRotation(candidate)) best_ = std::move(candidate);
  }

  // Whether the rotation is told, and roughly without any one of those that agree, which may by
  // accident.
  bool TellsRotation(const Candidate& candidate) const {
    const Similarity fit = Fit(candidate);
    const double weights = 1.0 / fit.variance;
    double without_one = fit.spread;
    for (const auto& support : candidate.support) {
      if (!support) continue;
      const Correspondence& match = matches_[*support];
      const double weight = 1.0 / match.variance;
      const double squared = (match.other - fit.centroid_other).squaredNorm();
      without_one =
          std::min(without_one, fit.spread - squared * weight * weights / (weights - weight));
    }
    const double variance = kMaxSdRotationRad * kMaxSdRotationRad;
    return fit.spread * variance >= 1.0 &&
           without_one * kWithoutOne * kWithoutOne * variance >= 1.0;
  }

  Alignment Describe() const {
    const Similarity fit = Fit(best_);
    Alignment alignment;
    alignment.T_reference_other = fit.Rigid();
    alignment.centroid = fit.centroid_reference;
    alignment.variance_m2 = fit.variance;
    alignment.variance_rad2 = 1.0 / fit.spread;
    for (const LandmarkIndex group : groups_.indices()) {
      if (best_.support[group]) alignment.signatures.push_back(groups_[group]);
    }
    return alignment;
  }

  const AlignmentOptions& options_;
  double gate_;
  IndexedVector<LandmarkIndex, GroupIndex> groups_;
  IndexedVector<LandmarkIndex, double> squared_;  // Scratch of Support().
  IndexedVector<MatchIndex, Correspondence> matches_;
  Candidate best_;
};

}  // namespace

std::vector<Match> CandidateMatches(const AlignmentPoints& reference,
                                    const AlignmentPoints& other) {
  std::map<GroupIndex, std::vector<ModeIndex>> in_reference;
  std::map<GroupIndex, std::vector<ModeIndex>> in_other;
  for (const ModeIndex i : reference.indices()) in_reference[reference[i].group].push_back(i);
  for (const ModeIndex j : other.indices()) in_other[other[j].group].push_back(j);
  std::vector<Match> matches;
  for (const auto& [group, modes] : in_other) {
    for (const ModeIndex j : modes) {
      for (const ModeIndex i : in_reference[group]) matches.push_back({group, i, j});
    }
  }
  return matches;
}

std::vector<Eigen::Vector2d> PositionsOf(const AlignmentPoints& points) {
  std::vector<Eigen::Vector2d> positions;
  for (const AlignmentPoint& point : points) positions.push_back(point.position);
  return positions;
}

double OccupiedArea(const std::vector<Eigen::Vector2d>& positions) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& position : positions) box.extend(position);
  return std::max(1.0, box.sizes().x()) * std::max(1.0, box.sizes().y());
}

std::optional<Alignment> AlignByConsensus(const AlignmentPoints& reference,
                                          const AlignmentPoints& other,
                                          const AlignmentOptions& options) {
  return AlignByConsensus(reference, other, OccupiedArea(PositionsOf(reference)), options);
}

std::optional<Alignment> AlignByConsensus(const AlignmentPoints& reference,
                                          const AlignmentPoints& other,
                                          double area_m2,
                                          const AlignmentOptions& options) {
  return Consensus(reference, other, area_m2, options).Find();
}

}  // namespace shiftmap

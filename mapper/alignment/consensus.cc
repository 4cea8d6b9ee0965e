// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/consensus.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
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

struct Correspondence {
  int group = 0;  // Of those that both frames have, in the order of AlignmentPoint::group.
  Eigen::Vector2d reference;
  Eigen::Vector2d other;
  double variance = 0.0;    // Per axis, both sides and the floor. [m²]
  double log_rarity = 0.0;  // log(A / 2πσ²), what agreement counts before its distance.
};

constexpr int kNone = -1;

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
  std::vector<int> support;  // Per group its best correspondence, or kNone.
  int count = 0;             // Groups that have one.
  double score = 0.0;        // Log-likelihood ratio to "every landmark stands anywhere".
};

// The groups that both frames have, ascending.
std::vector<int> CommonGroups(const std::vector<AlignmentPoint>& reference,
                              const std::vector<AlignmentPoint>& other) {
  const auto groups_of = [](const std::vector<AlignmentPoint>& points) {
    std::vector<int> groups;
    for (const AlignmentPoint& point : points) groups.push_back(point.group);
    std::sort(groups.begin(), groups.end());
    groups.erase(std::unique(groups.begin(), groups.end()), groups.end());
    return groups;
  };
  const std::vector<int> in_reference = groups_of(reference);
  const std::vector<int> in_other = groups_of(other);
  std::vector<int> common;
  std::set_intersection(in_reference.begin(),
                        in_reference.end(),
                        in_other.begin(),
                        in_other.end(),
                        std::back_inserter(common));
  return common;
}

// Finds the transform between two frames from the correspondences of their points.
class Consensus {
 public:
  Consensus(const std::vector<AlignmentPoint>& reference,
            const std::vector<AlignmentPoint>& other,
            double area,
            const AlignmentOptions& options)
      : options_(options),
        gate_(ChiSquareQuantile(options.gate_probability, 2)),
        groups_(CommonGroups(reference, other)),
        squared_(groups_.size()) {
    Match(reference, other, area);
    best_.support.assign(groups_.size(), kNone);
  }

  std::optional<Alignment> Find() {
    const auto count = static_cast<int>(matches_.size());
    if (count < options_.min_signatures) return std::nullopt;
    if (0.5 * count * (count - 1) <= std::min(kMaxAllPairs, 1.0 * options_.max_pairs)) {
      for (int i = 0; i < count; ++i) {
        for (int j = i + 1; j < count; ++j) Propose(i, j);
      }
    } else {
      std::mt19937_64 random(1);
      std::uniform_int_distribution<int> pick(0, count - 1);
      for (int k = 0; k < options_.max_pairs && k < SufficientDraws(); ++k) {
        const int first = pick(random);
        Propose(first, pick(random));
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

  const Correspondence& At(int match) const { return matches_[static_cast<std::size_t>(match)]; }

  void Match(const std::vector<AlignmentPoint>& reference,
             const std::vector<AlignmentPoint>& other,
             double area) {
    const auto place = [&](int group) -> std::optional<std::size_t> {
      const auto found = std::lower_bound(groups_.begin(), groups_.end(), group);
      if (found == groups_.end() || *found != group) return std::nullopt;
      return static_cast<std::size_t>(found - groups_.begin());
    };
    std::vector<std::vector<const AlignmentPoint*>> by_group(groups_.size());
    for (const AlignmentPoint& point : reference) {
      if (const auto group = place(point.group)) by_group[*group].push_back(&point);
    }
    const double floor = 2.0 * options_.position_floor_m * options_.position_floor_m;
    for (const AlignmentPoint& point : other) {
      const auto group = place(point.group);
      if (!group) continue;
      for (const AlignmentPoint* known : by_group[*group]) {
        const double variance = 0.5 * (known->cov.trace() + point.cov.trace()) + floor;
        matches_.push_back({static_cast<int>(*group),
                            known->position,
                            point.position,
                            variance,
                            std::log(area / (2.0 * std::numbers::pi * variance))});
      }
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

  Similarity Fit(const std::vector<int>& support) const {
    return FitOver([&](const auto& visit) {
      for (const int match : support) {
        if (match != kNone) visit(At(match));
      }
    });
  }

  Candidate Support(const Similarity& fit) {
    Candidate candidate{fit, std::vector<int>(groups_.size(), kNone)};
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      const Correspondence& match = matches_[i];
      const double squared = (fit * match.other - match.reference).squaredNorm() / match.variance;
      if (squared > gate_) continue;
      const auto group = static_cast<std::size_t>(match.group);
      int& support = candidate.support[group];
      if (support != kNone && squared >= squared_[group]) continue;
      candidate.count += support == kNone ? 1 : 0;
      squared_[group] = squared;
      support = static_cast<int>(i);
    }
    for (std::size_t group = 0; group < groups_.size(); ++group) {
      const int support = candidate.support[group];
      if (support != kNone) candidate.score += At(support).log_rarity - 0.5 * squared_[group];
    }
    return candidate;
  }

  Candidate Refine(Candidate candidate) {
    constexpr int kMaxIterations = 10;
    for (int i = 0; i < kMaxIterations; ++i) {
      Candidate next = Support(Fit(candidate.support));
      if (next.score <= candidate.score) break;
      candidate = std::move(next);
    }
    return candidate;
  }

  bool SupportsBest(int match) const {
    return best_.support[static_cast<std::size_t>(At(match).group)] == match;
  }

  // The transform that two correspondences tell of.
  void Propose(int i, int j) {
    const Correspondence& a = At(i);
    const Correspondence& b = At(j);
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
    constexpr double kWithoutOne = 3.0;
    const Similarity fit = Fit(candidate.support);
    const double weights = 1.0 / fit.variance;
    double without_one = fit.spread;
    for (const int support : candidate.support) {
      if (support == kNone) continue;
      const Correspondence& match = At(support);
      const double weight = 1.0 / match.variance;
      const double squared = (match.other - fit.centroid_other).squaredNorm();
      without_one =
          std::min(without_one, fit.spread - squared * weight * weights / (weights - weight));
    }
    const double variance = options_.max_sd_rotation_rad * options_.max_sd_rotation_rad;
    return fit.spread * variance >= 1.0 &&
           without_one * kWithoutOne * kWithoutOne * variance >= 1.0;
  }

  Alignment Describe() const {
    const Similarity fit = Fit(best_.support);
    Alignment alignment;
    alignment.T_reference_other = fit.Rigid();
    alignment.centroid = fit.centroid_reference;
    alignment.variance_m2 = fit.variance;
    alignment.variance_rad2 = 1.0 / fit.spread;
    for (std::size_t group = 0; group < groups_.size(); ++group) {
      if (best_.support[group] == kNone) continue;
      const Correspondence& match = At(best_.support[group]);
      alignment.signatures.push_back(groups_[group]);
      alignment.rms_m += (fit * match.other - match.reference).squaredNorm();
    }
    alignment.rms_m = std::sqrt(alignment.rms_m / best_.count);
    return alignment;
  }

  const AlignmentOptions& options_;
  double gate_;
  std::vector<int> groups_;
  std::vector<double> squared_;  // Scratch of Support().
  std::vector<Correspondence> matches_;
  Candidate best_;
};

}  // namespace

double OccupiedArea(const std::vector<Eigen::Vector2d>& positions) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& position : positions) box.extend(position);
  return std::max(1.0, box.sizes().x()) * std::max(1.0, box.sizes().y());
}

std::optional<Alignment> AlignByConsensus(const std::vector<AlignmentPoint>& reference,
                                          const std::vector<AlignmentPoint>& other,
                                          const AlignmentOptions& options) {
  std::vector<Eigen::Vector2d> positions;
  for (const AlignmentPoint& point : reference) positions.push_back(point.position);
  return AlignByConsensus(reference, other, OccupiedArea(positions), options);
}

std::optional<Alignment> AlignByConsensus(const std::vector<AlignmentPoint>& reference,
                                          const std::vector<AlignmentPoint>& other,
                                          double area_m2,
                                          const AlignmentOptions& options) {
  return Consensus(reference, other, area_m2, options).Find();
}

}  // namespace shiftmap

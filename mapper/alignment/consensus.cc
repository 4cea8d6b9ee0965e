// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/consensus.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <utility>

#include "mapstore/geometry/angle.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Two transforms that place the vehicle further apart than this are different answers, not two
// estimates of one.
constexpr double kDifferentMetres = 0.5;
constexpr double kDifferentRadians = 0.1;

struct Correspondence {
  int group = 0;
  Eigen::Vector2d reference;
  Eigen::Vector2d other;
  double variance = 0.0;  // Per axis, both sides and the floor. [m²]
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
  std::map<int, int> support;  // Group -> its best correspondence.
  double score = 0.0;          // Log-likelihood ratio to "every landmark stands anywhere".
};

std::vector<Correspondence> Match(const std::vector<AlignmentPoint>& reference,
                                  const std::vector<AlignmentPoint>& other,
                                  double floor_m) {
  std::multimap<int, const AlignmentPoint*> by_group;
  for (const AlignmentPoint& point : reference) by_group.emplace(point.group, &point);
  std::vector<Correspondence> matches;
  for (const AlignmentPoint& point : other) {
    const auto [begin, end] = by_group.equal_range(point.group);
    for (auto it = begin; it != end; ++it) {
      const double variance =
          0.5 * (it->second->cov.trace() + point.cov.trace()) + 2.0 * floor_m * floor_m;
      matches.push_back({point.group, it->second->position, point.position, variance});
    }
  }
  return matches;
}

// Least squares over the supporters, weighted by inverse variance; closed form.
Similarity Fit(const std::vector<Correspondence>& matches,
               const std::map<int, int>& support,
               double max_scale_error) {
  Similarity fit;
  double weights = 0.0;
  for (const auto& [group, index] : support) {
    const Correspondence& match = matches[static_cast<std::size_t>(index)];
    weights += 1.0 / match.variance;
    fit.centroid_reference += match.reference / match.variance;
    fit.centroid_other += match.other / match.variance;
  }
  fit.centroid_reference /= weights;
  fit.centroid_other /= weights;
  fit.variance = 1.0 / weights;
  double dot = 0.0;
  double cross = 0.0;
  for (const auto& [group, index] : support) {
    const Correspondence& match = matches[static_cast<std::size_t>(index)];
    const Eigen::Vector2d a = match.other - fit.centroid_other;
    const Eigen::Vector2d b = match.reference - fit.centroid_reference;
    dot += a.dot(b) / match.variance;
    cross += (a.x() * b.y() - a.y() * b.x()) / match.variance;
    fit.spread += a.squaredNorm() / match.variance;
  }
  fit.yaw = std::atan2(cross, dot);
  fit.R = Se2(0.0, 0.0, fit.yaw).Rotation();
  if (fit.spread > 0.0) {
    fit.scale = std::clamp(
        std::hypot(cross, dot) / fit.spread, 1.0 - max_scale_error, 1.0 + max_scale_error);
  }
  return fit;
}

Candidate Support(const std::vector<Correspondence>& matches,
                  const Similarity& fit,
                  double gate,
                  double area) {
  Candidate candidate{fit, {}, 0.0};
  std::map<int, double> best;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const Correspondence& match = matches[i];
    const double squared = (fit * match.other - match.reference).squaredNorm() / match.variance;
    if (squared > gate) continue;
    const auto [entry, added] = best.try_emplace(match.group, squared);
    if (added || squared < entry->second) {
      entry->second = squared;
      candidate.support[match.group] = static_cast<int>(i);
    }
  }
  for (const auto& [group, squared] : best) {
    const double variance = matches[static_cast<std::size_t>(candidate.support[group])].variance;
    candidate.score += std::log(area / (2.0 * std::numbers::pi * variance)) - 0.5 * squared;
  }
  return candidate;
}

Candidate Refine(const std::vector<Correspondence>& matches,
                 Candidate candidate,
                 double gate,
                 double area,
                 double max_scale_error) {
  constexpr int kMaxIterations = 10;
  for (int i = 0; i < kMaxIterations; ++i) {
    Candidate next = Support(matches, Fit(matches, candidate.support, max_scale_error), gate, area);
    if (next.score <= candidate.score) break;
    candidate = std::move(next);
  }
  return candidate;
}

bool Supports(const Candidate& candidate, int group, int match) {
  const auto found = candidate.support.find(group);
  return found != candidate.support.end() && found->second == match;
}

// The area of the box around all points, at least a square metre.
double OccupiedArea(const std::vector<AlignmentPoint>& points) {
  Eigen::AlignedBox2d box;
  for (const AlignmentPoint& point : points) box.extend(point.position);
  return std::max(1.0, box.sizes().x()) * std::max(1.0, box.sizes().y());
}

bool Different(const Se2& a, const Se2& b, const Eigen::Vector2d& centre) {
  return (a * centre - b * centre).norm() > kDifferentMetres ||
         std::abs(WrapAngle(a.yaw() - b.yaw())) > kDifferentRadians;
}

}  // namespace

std::optional<Alignment> AlignByConsensus(const std::vector<AlignmentPoint>& reference,
                                          const std::vector<AlignmentPoint>& other,
                                          const AlignmentOptions& options) {
  const std::vector<Correspondence> matches = Match(reference, other, options.position_floor_m);
  const auto count = static_cast<int>(matches.size());
  if (count < options.min_signatures) return std::nullopt;
  const double gate = ChiSquareQuantile(options.gate_probability, 2);
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  for (const Correspondence& match : matches) centre += match.other / count;

  const double area = OccupiedArea(reference);
  Candidate best;
  std::vector<Candidate> kept;
  const auto propose = [&](int i, int j) {
    const Correspondence& a = matches[static_cast<std::size_t>(i)];
    const Correspondence& b = matches[static_cast<std::size_t>(j)];
    if (a.group == b.group) return;
    // Two that support the best transform so far propose nothing but that.
    if (Supports(best, a.group, i) && Supports(best, b.group, j)) return;
    const double difference = (a.reference - b.reference).norm() - (a.other - b.other).norm();
    const double slack = options.max_scale_error * (a.reference - b.reference).norm();
    const double excess = std::max(0.0, std::abs(difference) - slack);
    if (excess * excess > gate * (a.variance + b.variance)) return;
    Candidate candidate = Support(
        matches, Fit(matches, {{a.group, i}, {b.group, j}}, options.max_scale_error), gate, area);
    if (static_cast<int>(candidate.support.size()) < options.min_signatures) return;
    candidate = Refine(matches, std::move(candidate), gate, area, options.max_scale_error);
    if (candidate.score > best.score) best = candidate;
    kept.push_back(std::move(candidate));
  };
  const double pairs = 0.5 * count * (count - 1);
  if (pairs <= options.max_pairs) {
    for (int i = 0; i < count; ++i) {
      for (int j = i + 1; j < count; ++j) propose(i, j);
    }
  } else {
    std::mt19937_64 random(1);
    std::uniform_int_distribution<int> pick(0, count - 1);
    for (int k = 0; k < options.max_pairs; ++k) propose(pick(random), pick(random));
  }
  if (best.support.empty()) return std::nullopt;

  const Similarity fit = Fit(matches, best.support, options.max_scale_error);
  Alignment alignment;
  alignment.T_reference_other = fit.Rigid();
  alignment.centroid = fit.centroid_reference;
  alignment.variance_m2 = fit.variance;
  alignment.variance_rad2 = 1.0 / fit.spread;
  for (const auto& [group, index] : best.support) {
    const Correspondence& match = matches[static_cast<std::size_t>(index)];
    alignment.signatures.push_back(group);
    alignment.rms_m += (fit * match.other - match.reference).squaredNorm();
  }
  alignment.rms_m = std::sqrt(alignment.rms_m / static_cast<double>(best.support.size()));
  for (const Candidate& candidate : kept) {
    if (Different(candidate.fit.Rigid(), alignment.T_reference_other, centre)) {
      alignment.runner_up =
          std::max(alignment.runner_up, static_cast<int>(candidate.support.size()));
    }
  }
  if (alignment.runner_up > static_cast<int>(best.support.size())) return std::nullopt;
  return alignment;
}

}  // namespace shiftmap

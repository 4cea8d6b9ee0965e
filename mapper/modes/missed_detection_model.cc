// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/missed_detection_model.h"

#include <cmath>
#include <cstddef>
#include <numbers>
#include <tuple>

namespace shiftmap {
namespace {

constexpr std::size_t kDirections = std::tuple_size_v<DirectionCounts>;
constexpr double kImpossible = -1e300;

// Nodes of the integral over the detection probability, in the middle of equal intervals.
constexpr int kNodes = 16;
using Nodes = Eigen::Array<double, kNodes, 1>;

Nodes DetectionNodes() { return (Nodes::LinSpaced(kNodes, 0.0, kNodes - 1.0) + 0.5) / kNodes; }

// Directions that can see a landmark: hypothesis 0 is all of them, 1 + f the half circle from f on.
constexpr std::size_t kHypotheses = 1 + kDirections;

bool Sees(std::size_t hypothesis, std::size_t direction) {
  if (hypothesis == 0) return true;
  return (direction + kDirections - (hypothesis - 1)) % kDirections < kDirections / 2;
}

int CountIn(std::size_t hypothesis, const DirectionCounts& counts) {
  int sum = 0;
  for (std::size_t i = 0; i < kDirections; ++i) sum += Sees(hypothesis, i) ? counts[i] : 0;
  return sum;
}

}  // namespace

std::size_t DirectionOf(const Eigen::Vector2d& view) {
  const double turn = std::atan2(view.y(), view.x()) / (2.0 * std::numbers::pi) + 0.5;
  return static_cast<std::size_t>(turn * kDirections) % kDirections;
}

double LogMissedPasses(const std::vector<DirectionCounts>& passes,
                       const Visibility& known,
                       const SensorCalibration& sensor,
                       const MissedDetectionOptions& options) {
  const Nodes p = DetectionNodes();
  const Nodes log_hit = p.log();
  const Nodes log_miss = (1.0 - p).log();
  const double hits = options.detection_concentration * sensor.detection_probability;
  const double misses = options.detection_concentration - hits;
  const Nodes log_prior = (hits - 1.0) * log_hit + (misses - 1.0) * log_miss;
  const int seen = CountIn(0, known.seen);
  const double occluded = sensor.occluded_visit_probability;
  const double half_circle = options.one_sided_probability / static_cast<double>(kDirections);

  using Terms = Eigen::Array<double, kNodes, kHypotheses>;
  Terms log_weights;
  Terms log_missed = Terms::Zero();
  for (std::size_t h = 0; h < kHypotheses; ++h) {
    const auto column = static_cast<Eigen::Index>(h);
    const double prior = h == 0 ? 1.0 - options.one_sided_probability : half_circle;
    const bool possible = prior > 0.0 && CountIn(h, known.seen) == seen;
    log_weights.col(column) = Nodes::Constant(kImpossible);
    if (possible) {
      log_weights.col(column) =
          std::log(prior) + log_prior + seen * log_hit + CountIn(h, known.missed) * log_miss;
    }
    for (const DirectionCounts& pass : passes) {
      const int scans = CountIn(h, pass);
      if (scans == 0) continue;
      log_missed.col(column) += (occluded + (1.0 - occluded) * (scans * log_miss).exp()).log();
    }
  }
  const auto log_sum = [](const Terms& terms) {
    const double largest = terms.maxCoeff();
    return largest + std::log((terms - largest).exp().sum());
  };
  return log_sum(log_weights + log_missed) - log_sum(log_weights);
}

}  // namespace shiftmap

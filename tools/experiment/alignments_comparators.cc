// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/alignments_comparators.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "mapper/rows.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr double kGateProbability = 0.99;

std::uint64_t Bit(int vertex) { return std::uint64_t{1} << vertex; }

class CliqueSearch {
 public:
  explicit CliqueSearch(const std::vector<std::uint64_t>& neighbours) : neighbours_(neighbours) {}

  std::uint64_t Find() {
    const auto count = static_cast<int>(neighbours_.size());
    Extend(0, count == 64 ? ~std::uint64_t{0} : Bit(count) - 1);
    return best_;
  }

 private:
  // @param candidates  Neighbours of all in the clique.
  void Extend(std::uint64_t clique, std::uint64_t candidates) {
    if (std::popcount(clique) > std::popcount(best_)) best_ = clique;
    std::vector<std::pair<int, int>> coloured;  // Vertex and colour, from 1 on, which ascends.
    std::uint64_t left = candidates;
    for (int colour = 1; left != 0; ++colour) {
      for (std::uint64_t free = left; free != 0;) {
        const int vertex = std::countr_zero(free);
        coloured.emplace_back(vertex, colour);
        left &= ~Bit(vertex);
        free &= ~(Bit(vertex) | neighbours_[static_cast<std::size_t>(vertex)]);
      }
    }
    while (!coloured.empty()) {
      const std::pair<int, int> last = coloured.back();
      coloured.pop_back();
      if (std::popcount(clique) + last.second <= std::popcount(best_)) return;
      Extend(clique | Bit(last.first),
             candidates & neighbours_[static_cast<std::size_t>(last.first)]);
      candidates &= ~Bit(last.first);
    }
  }

  const std::vector<std::uint64_t>& neighbours_;
  std::uint64_t best_ = 0;
};

Eigen::Matrix2d Block(const JointPoints& map, ModeIndex i, ModeIndex j) {
  return map.covariance.block<2, 2>(RowOf(i), RowOf(j));
}

// The distance of two points and its variance.
std::pair<double, double> Distance(const JointPoints& map, ModeIndex i, ModeIndex j) {
  const Eigen::Vector2d difference = map.points[i].position - map.points[j].position;
  const double distance = difference.norm();
  const Eigen::Vector2d along = difference / distance;
  const Eigen::Matrix2d cov =
      Block(map, i, i) + Block(map, j, j) - Block(map, i, j) - Block(map, j, i);
  return {distance, along.dot(cov * along)};
}

std::vector<PlacedTwice> PlacedInBoth(const JointPoints& reference,
                                      const JointPoints& other,
                                      double sd_scale) {
  std::vector<PlacedTwice> landmarks;
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();
  for (const ModeIndex i : reference.points.indices()) {
    landmarks.push_back({reference.points[i].position,
                         other.points[i].position,
                         0.5 * (Block(reference, i, i) + Block(other, i, i)).trace()});
    centroid += landmarks.back().reference / static_cast<double>(reference.points.size());
  }
  for (PlacedTwice& landmark : landmarks) {
    landmark.variance += 0.5 * sd_scale * sd_scale * (landmark.reference - centroid).squaredNorm();
  }
  return landmarks;
}

std::optional<Alignment> AlignBy(const std::vector<PlacedTwice>& landmarks,
                                 const std::vector<int>& inliers,
                                 const JointPoints& reference) {
  if (inliers.size() < 2) return std::nullopt;
  std::vector<double> weights(landmarks.size());
  Alignment alignment;
  double total = 0.0;
  for (const int inlier : inliers) {
    const auto i = static_cast<std::size_t>(inlier);
    weights[i] = 1.0;
    alignment.signatures.push_back(reference.points[ModeIndex(i)].group);
    alignment.centroid += landmarks[i].reference / landmarks[i].variance;
    total += 1.0 / landmarks[i].variance;
  }
  alignment.centroid /= total;
  alignment.T_reference_other = FitRigid(landmarks, weights);
  return alignment;
}

double SquaredResidual(const Se2& T_reference_other, const PlacedTwice& landmark) {
  return (landmark.reference - T_reference_other * landmark.other).squaredNorm() /
         landmark.variance;
}

}  // namespace

Se2 FitRigid(std::span<const PlacedTwice> landmarks, std::span<const double> weights) {
  double total = 0.0;
  Eigen::Vector2d centre_reference = Eigen::Vector2d::Zero();
  Eigen::Vector2d centre_other = Eigen::Vector2d::Zero();
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    const double weight = weights[i] / landmarks[i].variance;
    total += weight;
    centre_reference += weight * landmarks[i].reference;
    centre_other += weight * landmarks[i].other;
  }
  centre_reference /= total;
  centre_other /= total;
  double dot = 0.0;
  double cross = 0.0;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    const double weight = weights[i] / landmarks[i].variance;
    const Eigen::Vector2d a = landmarks[i].other - centre_other;
    const Eigen::Vector2d b = landmarks[i].reference - centre_reference;
    dot += weight * a.dot(b);
    cross += weight * (a.x() * b.y() - a.y() * b.x());
  }
  const Se2 turn(0.0, 0.0, std::atan2(cross, dot));
  return {centre_reference - turn * centre_other, turn.yaw()};
}

std::vector<int> MaximumClique(const std::vector<std::uint64_t>& neighbours) {
  std::vector<int> clique;
  for (std::uint64_t left = CliqueSearch(neighbours).Find(); left != 0; left &= left - 1) {
    clique.push_back(std::countr_zero(left));
  }
  return clique;
}

std::vector<double> GraduatedWeights(std::span<const PlacedTwice> landmarks, double bound2) {
  constexpr double kGrowth = 1.4;
  constexpr int kMaxIterations = 1000;
  std::vector<double> weights(landmarks.size(), 1.0);
  Se2 T = FitRigid(landmarks, weights);
  double worst = 0.0;
  for (const PlacedTwice& landmark : landmarks)
    worst = std::max(worst, SquaredResidual(T, landmark));
  if (worst <= bound2) return weights;
  double mu = bound2 / (2.0 * worst - bound2);
  for (int i = 0; i < kMaxIterations; ++i, mu *= kGrowth) {
    bool binary = true;
    int positive = 0;
    for (std::size_t k = 0; k < landmarks.size(); ++k) {
      const double squared = SquaredResidual(T, landmarks[k]);
      if (squared >= (mu + 1.0) / mu * bound2) {
        weights[k] = 0.0;
      } else if (squared <= mu / (mu + 1.0) * bound2) {
        weights[k] = 1.0;
      } else {
        weights[k] = std::sqrt(bound2 / squared * mu * (mu + 1.0)) - mu;
        binary = false;
      }
      positive += weights[k] > 0.0;
    }
    if (binary || positive < 2) break;
    T = FitRigid(landmarks, weights);
  }
  return weights;
}

std::optional<Alignment> AlignByPairwiseConsistency(const JointPoints& reference,
                                                    const JointPoints& other,
                                                    double sd_scale) {
  const double gate = ChiSquareQuantile(kGateProbability, 1);
  std::vector<std::uint64_t> neighbours(reference.points.size());
  for (std::size_t i = 0; i < neighbours.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const ModeIndex a(i);
      const ModeIndex b(j);
      const std::pair<double, double> in_reference = Distance(reference, a, b);
      const std::pair<double, double> in_other = Distance(other, a, b);
      const double difference = in_reference.first - in_other.first;
      const double variance =
          in_reference.second + in_other.second + std::pow(sd_scale * in_reference.first, 2);
      if (difference * difference > gate * variance) continue;
      neighbours[i] |= Bit(static_cast<int>(j));
      neighbours[j] |= Bit(static_cast<int>(i));
    }
  }
  return AlignBy(PlacedInBoth(reference, other, sd_scale), MaximumClique(neighbours), reference);
}

std::optional<Alignment> AlignByGraduatedNonConvexity(const JointPoints& reference,
                                                      const JointPoints& other,
                                                      double sd_scale) {
  const std::vector<PlacedTwice> landmarks = PlacedInBoth(reference, other, sd_scale);
  const std::vector<double> weights =
      GraduatedWeights(landmarks, ChiSquareQuantile(kGateProbability, 2));
  std::vector<int> inliers;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] > 0.5) inliers.push_back(static_cast<int>(i));
  }
  return AlignBy(landmarks, inliers, reference);
}

}  // namespace shiftmap

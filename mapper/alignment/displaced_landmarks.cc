// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/displaced_landmarks.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

namespace shiftmap {
namespace {

// A landmark whose own displacement gains less than this is not where a cluster starts. [nats]
constexpr double kMinSeedGain = 2.0;

constexpr int kMaxSweeps = 20;

class Search {
 public:
  Search(const Eigen::VectorXd& difference,
         const Eigen::MatrixXd& cov,
         const DisplacementOptions& options)
      : options_(options),
        information_(cov.llt().solve(Eigen::MatrixXd::Identity(cov.rows(), cov.cols()))),
        weighted_(information_ * difference),
        clusters_(static_cast<std::size_t>(difference.size() / 2), kNotDisplaced) {}

  std::vector<int> Run() {
    score_ = Score(clusters_);
    for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
      const bool added = AddCluster();
      if (!MoveSingly() && !added) break;
    }
    return Numbered();
  }

 private:
  static int Count(const std::vector<int>& clusters) {
    return *std::max_element(clusters.begin(), clusters.end()) + 1;
  }

  // Log posterior of clusters, without what all have in common. Empty clusters do not count.
  double Score(const std::vector<int>& clusters) const {
    const int count = Count(clusters);
    Eigen::MatrixXd M = Eigen::MatrixXd::Zero(2 * count, 2 * count);
    Eigen::VectorXd w = Eigen::VectorXd::Zero(2 * count);
    std::vector<int> members(static_cast<std::size_t>(count));
    for (std::size_t i = 0; i < clusters.size(); ++i) {
      if (clusters[i] < 0) continue;
      const auto row = static_cast<Eigen::Index>(2 * i);
      const Eigen::Index a = Eigen::Index{2} * clusters[i];
      ++members[static_cast<std::size_t>(clusters[i])];
      w.segment<2>(a) += weighted_.segment<2>(row);
      for (std::size_t j = 0; j < clusters.size(); ++j) {
        if (clusters[j] < 0) continue;
        M.block<2, 2>(a, Eigen::Index{2} * clusters[j]) +=
            information_.block<2, 2>(row, static_cast<Eigen::Index>(2 * j));
      }
    }
    const double information = 1.0 / (options_.sd_displacement_m * options_.sd_displacement_m);
    M.diagonal().array() += information;
    const Eigen::LLT<Eigen::MatrixXd> llt(M);
    double score = 0.5 * w.dot(llt.solve(w));
    for (Eigen::Index i = 0; i < M.rows(); ++i) {
      score -= std::log(llt.matrixLLT()(i, i)) - 0.5 * std::log(information);
    }
    for (const int size : members) {
      if (size == 0) continue;
      score += std::log(options_.probability_displaced) +
               (size - 1) * std::log(options_.probability_together);
    }
    return score;
  }

  // The best cluster of landmarks that are in none, grown from each of them. False if none gains.
  bool AddCluster() {
    const int cluster = FirstUnused();
    const double prior = std::log(options_.probability_displaced);
    std::vector<std::size_t> candidates;
    for (std::size_t i = 0; i < clusters_.size(); ++i) {
      if (clusters_[i] >= 0) continue;
      std::vector<int> alone = clusters_;
      alone[i] = cluster;
      // Their share of a common displacement may be small where each alone gains nothing.
      if (Score(alone) - prior + LogOccam(i) > score_ + kMinSeedGain) candidates.push_back(i);
    }
    std::pair<double, std::vector<int>> best{score_, {}};
    for (const std::size_t seed : candidates) {
      std::vector<int> grown = clusters_;
      grown[seed] = cluster;
      double score = Score(grown);
      for (;;) {
        std::pair<double, std::size_t> next{score, clusters_.size()};
        for (const std::size_t i : candidates) {
          if (grown[i] >= 0) continue;
          grown[i] = cluster;
          if (const double with = Score(grown); with > next.first) next = {with, i};
          grown[i] = kNotDisplaced;
        }
        if (next.second == clusters_.size()) break;
        grown[next.second] = cluster;
        score = next.first;
      }
      if (score > best.first) best = {score, std::move(grown)};
    }
    if (best.second.empty()) return false;
    score_ = best.first;
    clusters_ = std::move(best.second);
    return true;
  }

  // What integrating over the displacement of landmark `i` alone costs.
  double LogOccam(std::size_t i) const {
    const auto row = static_cast<Eigen::Index>(2 * i);
    const double variance = options_.sd_displacement_m * options_.sd_displacement_m;
    const Eigen::Matrix2d M =
        Eigen::Matrix2d::Identity() + variance * information_.block<2, 2>(row, row);
    return 0.5 * std::log(M(0, 0) * M(1, 1) - M(0, 1) * M(1, 0));
  }

  // Tries every landmark in every cluster, in none and in one of its own. True if any moved.
  bool MoveSingly() {
    bool moved = false;
    for (std::size_t i = 0; i < clusters_.size(); ++i) {
      const int before = clusters_[i];
      const int count = Count(clusters_);
      if (count == 0) return false;
      int best = before;
      clusters_[i] = kNotDisplaced;
      const int own = FirstUnused();
      for (int cluster = kNotDisplaced; cluster <= std::max(own, count - 1); ++cluster) {
        clusters_[i] = cluster;
        const double score = Score(clusters_);
        if (score <= score_ + 1e-9) continue;
        score_ = score;
        best = cluster;
      }
      clusters_[i] = best;
      moved |= best != before;
    }
    return moved;
  }

  int FirstUnused() const {
    int cluster = 0;
    while (std::find(clusters_.begin(), clusters_.end(), cluster) != clusters_.end()) ++cluster;
    return cluster;
  }

  // Clusters numbered by their first landmark, without gaps.
  std::vector<int> Numbered() const {
    std::vector<int> numbers(clusters_.size() + 1, kNotDisplaced);
    std::vector<int> result;
    int next = 0;
    for (const int cluster : clusters_) {
      if (cluster >= 0 && numbers[static_cast<std::size_t>(cluster)] < 0) {
        numbers[static_cast<std::size_t>(cluster)] = next++;
      }
      result.push_back(cluster < 0 ? kNotDisplaced : numbers[static_cast<std::size_t>(cluster)]);
    }
    return result;
  }

  DisplacementOptions options_;
  Eigen::MatrixXd information_;
  Eigen::VectorXd weighted_;
  std::vector<int> clusters_;
  double score_ = 0.0;
};

}  // namespace

std::vector<int> FindDisplaced(const Eigen::VectorXd& difference,
                               const Eigen::MatrixXd& cov,
                               const DisplacementOptions& options) {
  if (difference.size() == 0) return {};
  return Search(difference, cov, options).Run();
}

}  // namespace shiftmap

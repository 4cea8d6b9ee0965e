// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/displaced_landmarks.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "localizer/hypothesis/log_math.h"

namespace shiftmap {
namespace {

// Clusters are grown from this many landmarks, those that gain most.
constexpr std::size_t kSeeds = 20;

constexpr int kMaxSweeps = 20;
constexpr double kDatumDimension = 3.0;

class Search {
 public:
  Search(const std::vector<Eigen::Vector2d>& positions,
         const Eigen::VectorXd& difference,
         const Eigen::MatrixXd& cov,
         const DisplacementOptions& options)
      : options_(options),
        prior_(positions, options.prior),
        information_(cov.llt().solve(Eigen::MatrixXd::Identity(cov.rows(), cov.cols()))),
        weighted_(information_ * difference),
        squared_(difference.dot(weighted_)),
        dof_(std::max(1.0, static_cast<double>(difference.size()) - kDatumDimension)),
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
  // BᵀΛB and w, and the landmarks in each cluster.
  struct Clustered {
    Eigen::MatrixXd M;
    Eigen::VectorXd w;
    std::vector<std::vector<std::size_t>> members;
  };

  static int Count(const std::vector<int>& clusters) {
    return *std::max_element(clusters.begin(), clusters.end()) + 1;
  }

  Clustered Collect(const std::vector<int>& clusters) const {
    const Eigen::Index count = Count(clusters);
    Clustered sums{Eigen::MatrixXd::Zero(2 * count, 2 * count),
                   Eigen::VectorXd::Zero(2 * count),
                   std::vector<std::vector<std::size_t>>(static_cast<std::size_t>(count))};
    std::vector<std::size_t> members;
    for (std::size_t i = 0; i < clusters.size(); ++i) {
      if (clusters[i] >= 0) members.push_back(i);
    }
    for (const std::size_t i : members) {
      const auto row = static_cast<Eigen::Index>(2 * i);
      const Eigen::Index a = Eigen::Index{2} * clusters[i];
      sums.members[static_cast<std::size_t>(clusters[i])].push_back(i);
      sums.w.segment<2>(a) += weighted_.segment<2>(row);
      for (const std::size_t j : members) {
        sums.M.block<2, 2>(a, Eigen::Index{2} * clusters[j]) +=
            information_.block<2, 2>(row, static_cast<Eigen::Index>(2 * j));
      }
    }
    return sums;
  }

  // log p(d | B) for one sd of displacements, without what all clusters have in common.
  double LogLikelihood(const Clustered& sums, double sd) const {
    const double information = 1.0 / (sd * sd);
    Eigen::MatrixXd M = sums.M;
    M.diagonal().array() += information;
    const Eigen::LLT<Eigen::MatrixXd> llt(M);
    double log_determinant = 0.0;
    for (Eigen::Index i = 0; i < M.rows(); ++i) {
      log_determinant += 2.0 * std::log(llt.matrixLLT()(i, i)) - std::log(information);
    }
    const double nu = options_.variance_dof;
    const double rest = squared_ - sums.w.dot(llt.solve(sums.w));
    return -0.5 * log_determinant - 0.5 * (nu + dof_) * std::log1p(std::max(0.0, rest) / nu);
  }

  double LogPrior(const Clustered& sums) const {
    double log_prior = 0.0;
    for (const std::vector<std::size_t>& members : sums.members) {
      if (!members.empty()) log_prior += prior_.LogProbability(members);
    }
    return log_prior;
  }

  // Log posterior of clusters, without what all have in common. Empty clusters do not count.
  double Score(const std::vector<int>& clusters) const {
    const Clustered sums = Collect(clusters);
    double sum = -std::numeric_limits<double>::infinity();
    for (const double sd : options_.sd_displacement_m) sum = LogAdd(sum, LogLikelihood(sums, sd));
    return sum - std::log(static_cast<double>(options_.sd_displacement_m.size())) + LogPrior(sums);
  }

  // Landmarks in no cluster, those that gain most by being displaced alone first.
  std::vector<std::size_t> Candidates(int cluster) const {
    std::vector<std::pair<double, std::size_t>> losses;
    std::vector<int> alone = clusters_;
    for (std::size_t i = 0; i < clusters_.size(); ++i) {
      if (clusters_[i] >= 0) continue;
      alone[i] = cluster;
      losses.emplace_back(-Score(alone), i);
      alone[i] = kNotDisplaced;
    }
    std::sort(losses.begin(), losses.end());
    std::vector<std::size_t> candidates;
    for (const auto& [loss, i] : losses) candidates.push_back(i);
    return candidates;
  }

  // The best cluster of landmarks that are in none, grown from one after another. False if none
  // gains.
  bool AddCluster() {
    const int cluster = FirstUnused();
    const std::vector<std::size_t> candidates = Candidates(cluster);
    std::pair<double, std::vector<int>> best{score_, {}};
    for (std::size_t seed = 0; seed < std::min(kSeeds, candidates.size()); ++seed) {
      std::vector<int> grown = clusters_;
      grown[candidates[seed]] = cluster;
      const double score = Grow(candidates, cluster, &grown);
      if (score > best.first) best = {score, std::move(grown)};
    }
    if (best.second.empty()) return false;
    score_ = best.first;
    clusters_ = std::move(best.second);
    return true;
  }

  // Adds to a cluster what gains most, until nothing does. Returns the score.
  double Grow(const std::vector<std::size_t>& candidates,
              int cluster,
              std::vector<int>* clusters) const {
    double score = Score(*clusters);
    for (;;) {
      std::pair<double, std::size_t> next{score, clusters->size()};
      for (const std::size_t i : candidates) {
        if ((*clusters)[i] >= 0) continue;
        (*clusters)[i] = cluster;
        if (const double with = Score(*clusters); with > next.first) next = {with, i};
        (*clusters)[i] = kNotDisplaced;
      }
      if (next.second == clusters->size()) return score;
      (*clusters)[next.second] = cluster;
      score = next.first;
    }
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
  DisplacementPrior prior_;
  Eigen::MatrixXd information_;
  Eigen::VectorXd weighted_;
  double squared_;
  double dof_;
  std::vector<int> clusters_;
  double score_ = 0.0;
};

}  // namespace

std::vector<int> FindDisplaced(const std::vector<Eigen::Vector2d>& positions,
                               const Eigen::VectorXd& difference,
                               const Eigen::MatrixXd& cov,
                               const DisplacementOptions& options) {
  if (difference.size() == 0) return {};
  return Search(positions, difference, cov, options).Run();
}

}  // namespace shiftmap

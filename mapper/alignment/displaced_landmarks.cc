// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/displaced_landmarks.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <queue>
#include <set>
#include <tuple>
#include <utility>

#include "localizer/hypothesis/log_math.h"
#include "mapper/alignment/consensus.h"
#include "mapper/rows.h"

namespace shiftmap {
namespace {

// Clusters are grown from this many landmarks, those that gain most.
constexpr std::size_t kSeeds = 20;

constexpr int kMaxSweeps = 20;
constexpr int kSds = std::tuple_size_v<decltype(DisplacementOptions::sd_displacement_m)>;

// Variance factors of a map that are tried, for an integral over log v.
constexpr std::array<double, 8> kMapVarianceFactors = {
    1.0 / 32.0, 1.0 / 16.0, 1.0 / 8.0, 0.25, 0.5, 1.0, 2.0, 4.0};

// Noise that is less likely than the likeliest by this no longer takes part. One more displaced
// landmark does not make up for it.
constexpr double kNegligibleNoise = 20.0;

// Partitions that are less likely than the likeliest by more than this are left out.
const double kLogWindow = std::log(1000.0);

// Partitions whose neighbours are looked at.
constexpr int kMaxExpanded = 100;

// log of the density of log v for ν / v ~ χ²_ν, but for a constant.
double LogDensity(double v, double dof) { return -0.5 * dof * (std::log(v) + 1.0 / v); }

// The differences with noise of one size.
struct Noise {
  Eigen::MatrixXd information;  // Λ
  Eigen::VectorXd weighted;     // Λ d
  double log_weight = 0.0;      // log of the noise's prior and p(d) if nothing is displaced.
};

std::vector<Noise> NoiseOfAllSizes(const Eigen::VectorXd& difference,
                                   const DifferenceCovariance& cov,
                                   const DisplacementOptions& options) {
  std::vector<Noise> noise;
  for (const double s : options.run_variance_factors) {
    for (const double v : kMapVarianceFactors) {
      const Eigen::LLT<Eigen::MatrixXd> llt(cov.Sum(s, v));
      Noise& of_size = noise.emplace_back();
      of_size.information =
          llt.solve(Eigen::MatrixXd::Identity(difference.size(), difference.size()));
      of_size.weighted = of_size.information * difference;
      of_size.log_weight = LogDensity(v, options.map_variance_dof) -
                           0.5 * difference.dot(of_size.weighted) -
                           llt.matrixLLT().diagonal().array().log().sum();
    }
  }
  return noise;
}

class DisplacementSearch {
 public:
  DisplacementSearch(const std::vector<Eigen::Vector2d>& positions,
                     std::vector<Noise> noise,
                     Eigen::MatrixXd common,
                     const DisplacementOptions& options)
      : options_(options),
        prior_(positions, options.prior),
        noise_(std::move(noise)),
        common_(std::move(common)),
        clusters_(positions.size(), kNotDisplaced) {}

  std::vector<Displacement> Run() {
    grown_.push_back(clusters_);
    for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
      const bool added = AddCluster();
      if (!MoveSingly() && !added) break;
    }
    grown_.push_back(clusters_);
    return Window();
  }

 private:
  // The partitions in the window below the best one, with their probabilities.
  std::vector<Displacement> Window() const {
    const std::vector<std::size_t> sizes = SizesFor(clusters_);
    std::map<Clusters, double> scores;
    std::priority_queue<std::tuple<double, Clusters, bool>> open;
    const auto add = [&](const Clusters& clusters, bool is_start) {
      const auto [entry, is_new] = scores.try_emplace(Numbered(clusters), 0.0);
      if (is_new) {
        entry->second = Score(entry->first, sizes);
        open.emplace(entry->second, entry->first, is_start);
      }
      return entry->second;
    };
    for (const Clusters& clusters : grown_) {
      add(clusters, true);
      const int count = Count(clusters);
      for (int cluster = 0; cluster < count; ++cluster) add(Exchanged(clusters, cluster), true);
    }
    double best = std::get<double>(open.top());
    std::set<LandmarkIndex> doubtful;  // Others are moved in the starts only.
    for (int expanded = 0; expanded < kMaxExpanded && !open.empty(); ++expanded) {
      const auto [score, clusters, is_start] = open.top();
      if (score < best - kLogWindow) break;
      open.pop();
      const int count = Count(clusters);
      for (const LandmarkIndex i : clusters.indices()) {
        if (!is_start && !doubtful.contains(i)) continue;
        Clusters moved = clusters;
        for (moved[i] = kNotDisplaced; moved[i] <= count; ++moved[i]) {
          if (moved[i] == clusters[i]) continue;
          const double with = add(moved, false);
          best = std::max(best, with);
          if (with > best - kLogWindow) doubtful.insert(i);
        }
      }
    }
    return WithProbabilities(scores, best, sizes);
  }

  std::vector<Displacement> WithProbabilities(const std::map<Clusters, double>& scores,
                                              double best,
                                              const std::vector<std::size_t>& sizes) const {
    std::vector<Displacement> displacements;
    double sum = 0.0;
    for (const auto& [clusters, score] : scores) {
      if (score < best - kLogWindow) continue;
      displacements.push_back({clusters, std::exp(score - best), Common(clusters, sizes)});
      sum += displacements.back().probability;
    }
    for (Displacement& displacement : displacements) displacement.probability /= sum;
    std::ranges::stable_sort(displacements, std::greater(), &Displacement::probability);
    return displacements;
  }

  // E[e_common | d, B] with the likeliest noise, displacements being free.
  Eigen::VectorXd Common(const Clusters& clusters, const std::vector<std::size_t>& sizes) const {
    const std::vector<double> scores = Scores(clusters, sizes);
    const auto likeliest = std::max_element(scores.begin(), scores.end()) - scores.begin();
    const Noise& noise = noise_[sizes[static_cast<std::size_t>(likeliest)]];
    const Eigen::Index count = RowOf(Count(clusters));
    if (count == 0) return common_ * noise.weighted;
    Eigen::MatrixXd B = Eigen::MatrixXd::Zero(noise.weighted.size(), count);
    for (const LandmarkIndex i : clusters.indices()) {
      if (clusters[i] < 0) continue;
      B.block<2, 2>(RowOf(i), RowOf(clusters[i])).setIdentity();
    }
    const Eigen::MatrixXd LB = noise.information * B;
    Eigen::MatrixXd M = B.transpose() * LB;
    M.diagonal().array() += std::pow(options_.sd_displacement_m.back(), -2);
    return common_ * (noise.weighted - LB * M.llt().solve(B.transpose() * noise.weighted));
  }

  // With a cluster as what stayed, and what stayed as a cluster: the same differences, seen from
  // the other side.
  static Clusters Exchanged(Clusters clusters, int cluster) {
    for (int& of_landmark : clusters) {
      if (of_landmark == cluster) {
        of_landmark = kNotDisplaced;
      } else if (of_landmark == kNotDisplaced) {
        of_landmark = cluster;
      }
    }
    return clusters;
  }

  static int Count(const Clusters& clusters) {
    return *std::max_element(clusters.begin(), clusters.end()) + 1;
  }

  // log p(d | B) / p(d | 0) with noise of one size, averaged over the sd of displacements. Of one
  // or two clusters, as they mostly are, without an allocation.
  // @param displaced  Those that are in a cluster, one at least.
  double LogRatio(const Noise& noise,
                  const Clusters& clusters,
                  const std::vector<LandmarkIndex>& displaced,
                  int count) const {
    switch (count) {
      case 1:
        return LogRatioOfSize<2>(noise, clusters, displaced, count);
      case 2:
        return LogRatioOfSize<4>(noise, clusters, displaced, count);
      default:
        return LogRatioOfSize<Eigen::Dynamic>(noise, clusters, displaced, count);
    }
  }

  template <int kSize>
  double LogRatioOfSize(const Noise& noise,
                        const Clusters& clusters,
                        const std::vector<LandmarkIndex>& displaced,
                        int count) const {
    using Matrix = Eigen::Matrix<double, kSize, kSize>;
    using Vector = Eigen::Matrix<double, kSize, 1>;
    Matrix M = Matrix::Zero(2 * count, 2 * count);  // BᵀΛB
    Vector w = Vector::Zero(2 * count);
    for (const LandmarkIndex i : displaced) {
      const Eigen::Index a = RowOf(clusters[i]);
      w.template segment<2>(a) += noise.weighted.segment<2>(RowOf(i));
      for (const LandmarkIndex j : displaced) {
        M.template block<2, 2>(a, RowOf(clusters[j])) +=
            noise.information.block<2, 2>(RowOf(i), RowOf(j));
      }
    }
    Eigen::Matrix<double, kSds, 1> terms;
    Eigen::Index term = 0;
    double before = 0.0;  // σ⁻² on the diagonal so far.
    for (const double sd : options_.sd_displacement_m) {
      const double information = 1.0 / (sd * sd);
      M.diagonal().array() += information - std::exchange(before, information);
      const Eigen::LLT<Matrix> llt(M);
      const Vector whitened = llt.matrixL().solve(w);
      const double log_root = llt.matrixLLT().diagonal().array().log().sum();
      terms[term++] = 0.5 * whitened.squaredNorm() - log_root + count * std::log(information);
    }
    return LogSumExp(terms) - std::log(static_cast<double>(kSds));
  }

  // Log posterior of clusters, without what all have in common, with noise of each of some sizes.
  // Empty clusters do not count.
  std::vector<double> Scores(const Clusters& clusters,
                             const std::vector<std::size_t>& sizes) const {
    std::vector<LandmarkIndex> displaced;
    for (const LandmarkIndex i : clusters.indices()) {
      if (clusters[i] >= 0) displaced.push_back(i);
    }
    const int count = Count(clusters);
    const double log_prior = prior_.LogProbability(clusters);
    std::vector<double> scores;
    for (const std::size_t size : sizes) {
      const Noise& noise = noise_[size];
      const double log_ratio =
          displaced.empty() ? 0.0 : LogRatio(noise, clusters, displaced, count);
      scores.push_back(noise.log_weight + log_ratio + log_prior);
    }
    return scores;
  }

  double Score(const Clusters& clusters, const std::vector<std::size_t>& sizes) const {
    const std::vector<double> scores = Scores(clusters, sizes);
    return LogSumExp(Eigen::Map<const Eigen::VectorXd>(scores.data(), std::ssize(scores)));
  }

  // The sizes of noise that are not negligible with such clusters.
  std::vector<std::size_t> SizesFor(const Clusters& clusters) const {
    std::vector<std::size_t> sizes(noise_.size());
    std::iota(sizes.begin(), sizes.end(), std::size_t{0});
    const std::vector<double> scores = Scores(clusters, sizes);
    const double least = *std::max_element(scores.begin(), scores.end()) - kNegligibleNoise;
    std::erase_if(sizes, [&](std::size_t size) { return scores[size] < least; });
    return sizes;
  }

  // Landmarks in no cluster, those that gain most by being displaced alone first.
  std::vector<LandmarkIndex> Candidates(int cluster) const {
    const std::vector<std::size_t> sizes = SizesFor(clusters_);
    std::vector<std::pair<double, LandmarkIndex>> losses;
    Clusters alone = clusters_;
    for (const LandmarkIndex i : clusters_.indices()) {
      if (clusters_[i] >= 0) continue;
      alone[i] = cluster;
      losses.emplace_back(-Score(alone, sizes), i);
      alone[i] = kNotDisplaced;
    }
    std::sort(losses.begin(), losses.end());
    std::vector<LandmarkIndex> candidates;
    for (const auto& [loss, i] : losses) candidates.push_back(i);
    return candidates;
  }

  // The best cluster of landmarks that are in none, grown from one after another. False if none
  // gains.
  bool AddCluster() {
    const int cluster = FirstUnused();
    const std::vector<LandmarkIndex> candidates = Candidates(cluster);
    std::pair<double, Clusters> best{Score(clusters_, SizesFor(clusters_)), {}};
    IndexedVector<LandmarkIndex, bool> grown_over(
        clusters_.size());  // It would grow again from these.
    for (std::size_t seed = 0; seed < std::min(kSeeds, candidates.size()); ++seed) {
      if (grown_over[candidates[seed]]) continue;
      Clusters grown = clusters_;
      grown[candidates[seed]] = cluster;
      const double score = Grow(candidates, cluster, &grown);
      for (const LandmarkIndex i : grown.indices()) {
        if (grown[i] == cluster) grown_over[i] = true;
      }
      grown_.push_back(grown);
      if (score > best.first) best = {score, std::move(grown)};
    }
    if (best.second.empty()) return false;
    clusters_ = std::move(best.second);
    return true;
  }

  // Adds to a cluster what gains most, until nothing does. Returns the score.
  double Grow(const std::vector<LandmarkIndex>& candidates, int cluster, Clusters* clusters) const {
    for (;;) {
      const std::vector<std::size_t> sizes = SizesFor(*clusters);
      const double score = Score(*clusters, sizes);
      std::pair<double, LandmarkIndex> next{score, clusters->end_index()};
      for (const LandmarkIndex i : candidates) {
        if ((*clusters)[i] >= 0) continue;
        (*clusters)[i] = cluster;
        if (const double with = Score(*clusters, sizes); with > next.first) next = {with, i};
        (*clusters)[i] = kNotDisplaced;
      }
      if (next.second == clusters->end_index()) return score;
      (*clusters)[next.second] = cluster;
    }
  }

  // Tries every landmark in every cluster, in none and in one of its own. True if any moved.
  bool MoveSingly() {
    bool moved = false;
    const std::vector<std::size_t> sizes = SizesFor(clusters_);
    double highest = Score(clusters_, sizes);
    for (int& of_landmark : clusters_) {
      const int before = of_landmark;
      const int count = Count(clusters_);
      if (count == 0) return moved;
      int best = before;
      of_landmark = kNotDisplaced;
      const int own = FirstUnused();
      for (int cluster = kNotDisplaced; cluster <= std::max(own, count - 1); ++cluster) {
        of_landmark = cluster;
        const double score = Score(clusters_, sizes);
        if (score <= highest + 1e-9) continue;
        highest = score;
        best = cluster;
      }
      of_landmark = best;
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
  static Clusters Numbered(const Clusters& clusters) {
    std::vector<int> numbers(clusters.size() + 1, kNotDisplaced);
    Clusters result;
    int next = 0;
    for (const int cluster : clusters) {
      if (cluster >= 0 && numbers[static_cast<std::size_t>(cluster)] < 0) {
        numbers[static_cast<std::size_t>(cluster)] = next++;
      }
      result.push_back(cluster < 0 ? kNotDisplaced : numbers[static_cast<std::size_t>(cluster)]);
    }
    return result;
  }

  DisplacementOptions options_;
  DisplacementPrior prior_;
  std::vector<Noise> noise_;
  Eigen::MatrixXd common_;
  Clusters clusters_;
  std::vector<Clusters> grown_;
};

}  // namespace

std::vector<Displacement> FindDisplaced(const std::vector<Eigen::Vector2d>& positions,
                                        const Eigen::VectorXd& difference,
                                        const DifferenceCovariance& cov,
                                        const DisplacementOptions& options) {
  if (difference.size() == 0) return {{{}, 1.0, {}}};
  return DisplacementSearch(
             positions, NoiseOfAllSizes(difference, cov, options), cov.common, options)
      .Run();
}

}  // namespace shiftmap

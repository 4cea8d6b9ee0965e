// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/displaced_landmarks.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "localizer/hypothesis/log_math.h"
#include "mapper/datum.h"

namespace shiftmap {
namespace {

// Landmarks on a site, those nearest to the first one first, with noise of `sd_m` each and a datum
// that floats.
class Site {
 public:
  explicit Site(int count, double sd_m, unsigned seed) : random_(seed) {
    std::uniform_real_distribution<double> anywhere(0.0, 10.0);
    for (int i = 0; i < count; ++i) positions_.emplace_back(anywhere(random_), anywhere(random_));
    std::sort(positions_.begin() + 1, positions_.end(), [&](const auto& a, const auto& b) {
      return (a - positions_.front()).norm() < (b - positions_.front()).norm();
    });
    cov_ = Eigen::MatrixXd::Identity(2 * count, 2 * count) * (sd_m * sd_m);
    const Eigen::MatrixXd G = DatumDirections(positions_);
    cov_ += 100.0 * G * G.transpose();
  }

  const std::vector<Eigen::Vector2d>& positions() const { return positions_; }
  const Eigen::MatrixXd& cov() const { return cov_; }

  // Differences if the first `moved` landmarks went by `shift` together.
  Eigen::VectorXd Difference(int moved, const Eigen::Vector2d& shift) {
    std::normal_distribution<double> normal;
    Eigen::VectorXd z(cov_.rows());
    for (double& value : z) value = normal(random_);
    Eigen::VectorXd difference = cov_.llt().matrixL() * z;
    for (int i = 0; i < moved; ++i) difference.segment<2>(Eigen::Index{2} * i) += shift;
    return difference;
  }

 private:
  std::mt19937_64 random_;
  std::vector<Eigen::Vector2d> positions_;
  Eigen::MatrixXd cov_;
};

int Count(const std::vector<int>& clusters) {
  int count = 0;
  for (const int cluster : clusters) count += cluster != kNotDisplaced;
  return count;
}

// log p(d | B) + log p(B) of a partition, from the full covariance of the differences: Student's t
// with the determinant, averaged over the sd of displacements. Like the search it leaves out what
// all partitions have in common but the determinant of `cov`.
double BruteForceScore(const std::vector<Eigen::Vector2d>& positions,
                       const Eigen::VectorXd& difference,
                       const Eigen::MatrixXd& cov,
                       const std::vector<int>& clusters,
                       const DisplacementOptions& options) {
  std::map<int, std::vector<std::size_t>> members;
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    if (clusters[i] != kNotDisplaced) members[clusters[i]].push_back(i);
  }
  const DisplacementPrior prior(positions, options.prior);
  double log_prior = 0.0;
  for (const auto& [cluster, of_cluster] : members) log_prior += prior.LogProbability(of_cluster);
  const double nu = options.variance_dof;
  const double n = static_cast<double>(difference.size()) - 3.0;
  Eigen::VectorXd log_likelihoods(std::ssize(options.sd_displacement_m));
  Eigen::Index k = 0;
  for (const double sd : options.sd_displacement_m) {
    Eigen::MatrixXd of_clusters = cov;
    for (std::size_t i = 0; i < clusters.size(); ++i) {
      for (std::size_t j = 0; j < clusters.size(); ++j) {
        if (clusters[i] == kNotDisplaced || clusters[i] != clusters[j]) continue;
        of_clusters.block<2, 2>(static_cast<Eigen::Index>(2 * i),
                                static_cast<Eigen::Index>(2 * j)) +=
            sd * sd * Eigen::Matrix2d::Identity();
      }
    }
    const Eigen::LLT<Eigen::MatrixXd> llt(of_clusters);
    double log_determinant = 0.0;
    for (Eigen::Index i = 0; i < cov.rows(); ++i) {
      log_determinant += 2.0 * std::log(llt.matrixL()(i, i));
    }
    log_likelihoods[k++] = -0.5 * log_determinant -
                           0.5 * (nu + n) * std::log1p(difference.dot(llt.solve(difference)) / nu);
  }
  return log_prior + LogSumExp(log_likelihoods);
}

// Every partition of four landmarks into clusters and those not displaced.
std::vector<std::vector<int>> Partitions(int count) {
  std::vector<std::vector<int>> partitions = {{}};
  for (int i = 0; i < count; ++i) {
    std::vector<std::vector<int>> longer;
    for (const std::vector<int>& partition : partitions) {
      int next = 0;
      for (const int cluster : partition) next = std::max(next, cluster + 1);
      for (int cluster = kNotDisplaced; cluster <= next; ++cluster) {
        longer.push_back(partition);
        longer.back().push_back(cluster);
      }
    }
    partitions = std::move(longer);
  }
  return partitions;
}

TEST(FindDisplaced, FindsTheMostLikelyPartition) {
  const DisplacementOptions options;
  int differs = 0;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    Site site(6, 0.05, seed);
    const double shift = 0.1 * (seed % 8);
    const Eigen::VectorXd difference =
        site.Difference(static_cast<int>(seed % 4), Eigen::Vector2d(shift, 0.5 * shift));
    double best = -1e300;
    for (const std::vector<int>& partition : Partitions(6)) {
      best = std::max(
          best, BruteForceScore(site.positions(), difference, site.cov(), partition, options));
    }
    const std::vector<int> found = FindDisplaced(site.positions(), difference, site.cov(), options);
    const double score = BruteForceScore(site.positions(), difference, site.cov(), found, options);
    EXPECT_LE(score, best + 1e-6);
    differs += score < best - 1e-6;
  }
  // The search is greedy; it may miss the optimum where nothing is clear.
  EXPECT_LE(differs, 5);
}

TEST(FindDisplaced, NothingMovedIsNothingDisplaced) {
  int displaced = 0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    Site site(15, 0.06, seed);
    displaced += Count(FindDisplaced(
        site.positions(), site.Difference(0, Eigen::Vector2d::Zero()), site.cov(), {}));
  }
  EXPECT_LE(displaced, 15);  // Of 3,000.
}

TEST(FindDisplaced, TellsTheFewThatMovedFromTheManyThatStayed) {
  int right = 0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    Site site(15, 0.06, seed);
    const std::vector<int> found =
        FindDisplaced(site.positions(), site.Difference(4, {0.4, 0.0}), site.cov(), {});
    bool same = true;
    for (int i = 0; i < 15; ++i) same &= (found[static_cast<std::size_t>(i)] >= 0) == (i < 4);
    right += same;
  }
  EXPECT_GE(right, 97);
}

TEST(FindDisplaced, CovariancesTwiceAsLargeAsTheErrorsHideNothing) {
  int right = 0;
  for (unsigned seed = 1; seed <= 50; ++seed) {
    Site site(15, 0.03, seed);
    const Eigen::VectorXd difference = site.Difference(4, {0.2, 0.0});
    const Eigen::MatrixXd too_large = 4.0 * site.cov();
    right += Count(FindDisplaced(site.positions(), difference, too_large, {})) == 4;
  }
  EXPECT_GE(right, 45);
}

TEST(FindDisplaced, CovariancesHalfAsLargeAsTheErrorsDisplaceLittle) {
  int displaced = 0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    Site site(15, 0.06, seed);
    const Eigen::MatrixXd too_small = 0.25 * site.cov();
    displaced +=
        Count(FindDisplaced(
            site.positions(), site.Difference(0, Eigen::Vector2d::Zero()), too_small, {})) > 0;
  }
  EXPECT_LE(displaced, 15);  // Of 200 sites.
}

TEST(FindDisplaced, SeveralTogetherAreFoundWhereOneAloneIsNot) {
  int together = 0;
  int alone = 0;
  for (unsigned seed = 1; seed <= 50; ++seed) {
    Site site(15, 0.06, seed);
    together +=
        Count(FindDisplaced(site.positions(), site.Difference(4, {0.2, 0.0}), site.cov(), {})) == 4;
    Site other(15, 0.06, seed);
    alone += Count(FindDisplaced(
                 other.positions(), other.Difference(1, {0.2, 0.0}), other.cov(), {})) == 1;
  }
  EXPECT_GT(together, alone);
}

TEST(FindDisplaced, NoLandmarksAreNoClusters) {
  EXPECT_TRUE(FindDisplaced({}, Eigen::VectorXd(), Eigen::MatrixXd(), {}).empty());
}

}  // namespace
}  // namespace shiftmap

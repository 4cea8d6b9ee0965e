// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/displaced_landmarks.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "localizer/hypothesis/log_math.h"
#include "mapper/covariance/gauge.h"

namespace shiftmap {
namespace {

// Landmarks on a site, those nearest to the first one first, with noise of `sd_m` each, a third of
// it the run's, and a gauge that floats.
class Site {
 public:
  explicit Site(int count, double sd_m, unsigned seed) : random_(seed) {
    std::uniform_real_distribution<double> anywhere(0.0, 2.6 * std::sqrt(count));
    for (int i = 0; i < count; ++i) positions_.emplace_back(anywhere(random_), anywhere(random_));
    std::sort(positions_.begin() + 1, positions_.end(), [&](const auto& a, const auto& b) {
      return (a - positions_.front()).norm() < (b - positions_.front()).norm();
    });
    const Eigen::Index size = Eigen::Index{2} * count;
    const Eigen::MatrixXd noise = Eigen::MatrixXd::Identity(size, size) * (sd_m * sd_m);
    const Eigen::MatrixXd G = GaugeDirections(positions_);
    cov_ = {noise / 3.0, 2.0 * noise / 3.0, 100.0 * G * G.transpose()};
  }

  const std::vector<Eigen::Vector2d>& positions() const { return positions_; }
  const DifferenceCovariance& cov() const { return cov_; }

  // That of the map, and of the run, off by factors.
  DifferenceCovariance CovarianceOff(double run_factor, double map_factor) const {
    return {run_factor * cov_.run, map_factor * cov_.map, cov_.common};
  }

  // Differences if the first `moved` landmarks went by `shift` together.
  Eigen::VectorXd Difference(int moved, const Eigen::Vector2d& shift) {
    std::normal_distribution<double> normal;
    Eigen::VectorXd z(cov_.run.rows());
    for (double& value : z) value = normal(random_);
    Eigen::VectorXd difference = cov_.Sum(1.0, 1.0).llt().matrixL() * z;
    for (int i = 0; i < moved; ++i) difference.segment<2>(Eigen::Index{2} * i) += shift;
    return difference;
  }

 private:
  std::mt19937_64 random_;
  std::vector<Eigen::Vector2d> positions_;
  DifferenceCovariance cov_;
};

int Count(const std::vector<int>& clusters) {
  int count = 0;
  for (const int cluster : clusters) count += cluster != kNotDisplaced;
  return count;
}

// log p(d | B) + log p(B) of a partition, from the full covariance of the differences, averaged
// over the sd of displacements, the run's variance factor, and that of the map a factor of two
// apart.
double BruteForceScore(const std::vector<Eigen::Vector2d>& positions,
                       const Eigen::VectorXd& difference,
                       const DifferenceCovariance& cov,
                       const std::vector<int>& clusters,
                       const DisplacementOptions& options) {
  const double nu = options.map_variance_dof;
  std::vector<double> terms;
  for (const double sd : options.sd_displacement_m) {
    for (const double s : options.run_variance_factors) {
      for (int power = -5; power <= 2; ++power) {
        const double v = std::exp2(power);
        Eigen::MatrixXd of_clusters = s * cov.run + v * cov.map + cov.common;
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
        for (Eigen::Index i = 0; i < of_clusters.rows(); ++i) {
          log_determinant += 2.0 * std::log(llt.matrixL()(i, i));
        }
        // χ²_ν at ν / v, as a density of log v.
        const double chi_square = nu / v;
        terms.push_back(0.5 * nu * std::log(chi_square) - 0.5 * chi_square - 0.5 * log_determinant -
                        0.5 * difference.dot(llt.solve(difference)));
      }
    }
  }
  return DisplacementPrior(positions, options.prior).LogProbability(clusters) +
         LogSumExp(Eigen::Map<const Eigen::VectorXd>(terms.data(), std::ssize(terms)));
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
    const DifferenceCovariance too_large = site.CovarianceOff(1.0, 5.5);
    right += Count(FindDisplaced(site.positions(), difference, too_large, {})) == 4;
  }
  EXPECT_GE(right, 45);
}

TEST(FindDisplaced, CovariancesHalfAsLargeAsTheErrorsDisplaceLittle) {
  int displaced = 0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    Site site(15, 0.06, seed);
    const DifferenceCovariance too_small = site.CovarianceOff(0.25, 0.25);
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

// Among many landmarks some are always off to one side.
TEST(FindDisplaced, NoiseOfManyLandmarksIsNoDisplacement) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Site site(150, 0.06, seed);
    const Eigen::VectorXd noise = site.Difference(0, Eigen::Vector2d::Zero());
    EXPECT_LE(Count(FindDisplaced(site.positions(), noise, site.cov(), {})), 2) << seed;
    Site changed(150, 0.06, seed);
    const std::vector<int> found =
        FindDisplaced(changed.positions(), changed.Difference(6, {0.6, 0.3}), changed.cov(), {});
    for (int i = 0; i < 6; ++i) EXPECT_GE(found[static_cast<std::size_t>(i)], 0) << i;
    EXPECT_LE(Count(found), 8) << seed;
  }
}

// That a map is better than it says is no reason to trust the run beyond what it says.
TEST(FindDisplaced, WhatTheRunHardlyKnowsIsNotDisplacedInABetterMap) {
  constexpr Eigen::Index kAt = 18;  // x of landmark 9.
  int displaced = 0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    Site site(15, 0.06, seed);
    Eigen::VectorXd difference = 0.2 * site.Difference(0, Eigen::Vector2d::Zero());
    DifferenceCovariance cov = site.CovarianceOff(0.04, 1.0);
    cov.run(kAt, kAt) += 0.25 * 0.25;
    difference[kAt] += 0.6;
    displaced += FindDisplaced(site.positions(), difference, cov, {})[9] >= 0;
  }
  EXPECT_LE(displaced, 10);
}

TEST(FindDisplaced, NoLandmarksAreNoClusters) {
  EXPECT_TRUE(FindDisplaced({}, Eigen::VectorXd(), {}, {}).empty());
}

}  // namespace
}  // namespace shiftmap

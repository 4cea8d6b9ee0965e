// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/displaced_landmarks.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "localizer/hypothesis/log_math.h"
#include "mapper/alignment/explain_displacements.h"
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

std::vector<int> Likeliest(const std::vector<Eigen::Vector2d>& positions,
                           const Eigen::VectorXd& difference,
                           const DifferenceCovariance& cov,
                           const DisplacementOptions& options) {
  return FindDisplaced(positions, difference, cov, options).front().clusters;
}

// Every partition of landmarks into clusters and those not displaced.
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
    const std::vector<int> found = Likeliest(site.positions(), difference, site.cov(), options);
    const double score = BruteForceScore(site.positions(), difference, site.cov(), found, options);
    EXPECT_LE(score, best + 1e-6);
    differs += score < best - 1e-6;
  }
  // The search is greedy; it may miss the optimum where nothing is clear.
  EXPECT_LE(differs, 5);
}

TEST(FindDisplaced, ProbabilitiesAreThoseOfEnumeration) {
  const DisplacementOptions options;
  double in_doubt = 0.0;
  for (unsigned seed = 1; seed <= 30; ++seed) {
    Site site(6, 0.05, seed);
    const Eigen::VectorXd difference =
        site.Difference(static_cast<int>(seed % 4), {0.08 * (seed % 8), 0.0});
    const std::vector<std::vector<int>> partitions = Partitions(6);
    Eigen::VectorXd scores(std::ssize(partitions));
    for (std::size_t i = 0; i < partitions.size(); ++i) {
      scores[static_cast<Eigen::Index>(i)] =
          BruteForceScore(site.positions(), difference, site.cov(), partitions[i], options);
    }
    const double sum = LogSumExp(scores);
    for (const Displacement& found :
         FindDisplaced(site.positions(), difference, site.cov(), options)) {
      const double exact = std::exp(
          BruteForceScore(site.positions(), difference, site.cov(), found.clusters, options) - sum);
      EXPECT_NEAR(found.probability, exact, 0.05) << seed;  // The window leaves out some.
      if (exact < 0.9) in_doubt += exact;
    }
  }
  EXPECT_GT(in_doubt, 3.0);  // Else there was little to tell.
}

// Of data that the model draws.
TEST(FindDisplaced, WhatIsProbableIsRightAsOften) {
  constexpr int kLandmarks = 6;
  DisplacementOptions options;
  options.prior.probability_displaced = 0.5;
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  const std::vector<std::vector<int>> partitions = Partitions(kLandmarks);
  std::vector<double> map_factors;
  std::vector<double> map_weights;
  for (int power = -5; power <= 2; ++power) {
    const double v = std::exp2(power);
    map_factors.push_back(v);
    map_weights.push_back(std::exp(-0.5 * options.map_variance_dof * (std::log(v) + 1.0 / v)));
  }
  std::discrete_distribution<std::size_t> map_factor(map_weights.begin(), map_weights.end());
  double expected = 0.0;
  double variance = 0.0;
  int right = 0;
  for (unsigned seed = 1; seed <= 400; ++seed) {
    const Site site(kLandmarks, 0.05, seed);
    const DisplacementPrior prior(site.positions(), options.prior);
    std::vector<double> weights;
    for (const std::vector<int>& partition : partitions) {
      weights.push_back(std::exp(prior.LogProbability(partition)));
    }
    const std::vector<int>& truth =
        partitions[std::discrete_distribution<std::size_t>(weights.begin(), weights.end())(random)];
    const double sd = options.sd_displacement_m[random() % 3];
    const Eigen::MatrixXd root =
        site.cov()
            .Sum(options.run_variance_factors[random() % 2], map_factors[map_factor(random)])
            .llt()
            .matrixL();
    Eigen::VectorXd z(root.rows());
    for (double& value : z) value = normal(random);
    Eigen::VectorXd difference = root * z;
    for (int cluster = 0; cluster < kLandmarks; ++cluster) {
      const Eigen::Vector2d shift = sd * Eigen::Vector2d(normal(random), normal(random));
      for (int i = 0; i < kLandmarks; ++i) {
        if (truth[static_cast<std::size_t>(i)] == cluster) {
          difference.segment<2>(Eigen::Index{2} * i) += shift;
        }
      }
    }
    const Displacement best =
        FindDisplaced(site.positions(), difference, site.cov(), options).front();
    expected += best.probability;
    variance += best.probability * (1.0 - best.probability);
    right += best.clusters == truth;
  }
  // Up to 0.05 of each is what the window leaves out.
  EXPECT_GT(right, expected - 0.05 * 400 - 3.0 * std::sqrt(variance));
  EXPECT_LT(right, expected + 3.0 * std::sqrt(variance));
  EXPECT_LT(expected, 0.9 * 400);
}

// Half moved together: which half?
TEST(ExplainDisplacements, TwoHalvesAreTwoFrames) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    Site site(8, 0.03, seed);
    const Explanations found = ExplainDisplacements(
        {0, 1, 2, 3, 4, 5, 6, 7},
        FindDisplaced(site.positions(), site.Difference(4, {1.0, 0.0}), site.cov(), {}),
        0.4);
    ASSERT_GE(found.frames.size(), 2u) << seed;
    const std::vector<GroupIndex> near = {0, 1, 2, 3};
    const std::vector<GroupIndex> far = {4, 5, 6, 7};
    for (const std::size_t i : {0u, 1u}) {
      const Explanation& frame = found.frames[i];
      EXPECT_GT(frame.probability, 0.01) << seed;
      EXPECT_TRUE((frame.moved == near && frame.alignment.signatures == far) ||
                  (frame.moved == far && frame.alignment.signatures == near))
          << seed;
    }
    EXPECT_NE(found.frames[0].moved, found.frames[1].moved) << seed;
    EXPECT_EQ(found.deciding.size(), 8u) << seed;
  }
}

TEST(ExplainDisplacements, FramesThatAreAlikeAreOne) {
  Site site(8, 0.03, 1);
  const std::vector<Displacement> found =
      FindDisplaced(site.positions(), site.Difference(4, {0.25, 0.0}), site.cov(), {});
  ASSERT_GE(found.size(), 2u);
  const Explanations together = ExplainDisplacements({0, 1, 2, 3, 4, 5, 6, 7}, found, 0.4);
  ASSERT_EQ(together.frames.size(), 1u);
  const Explanation& frame = together.frames[0];
  EXPECT_NEAR(frame.probability, 1.0, 1e-9);
  for (const auto& [group, stays] : frame.given.stays) {
    double sum = 0.0;
    for (const Displacement& displacement : found) {
      if (displacement.clusters[LandmarkIndex(group.value())] == kNotDisplaced) {
        sum += displacement.probability;
      }
    }
    EXPECT_NEAR(stays, sum, 1e-9) << group.value();
  }
  EXPECT_EQ(BySets(frame).frames.size(), frame.given.alternatives.size());
}

TEST(FindDisplaced, NothingMovedIsNothingDisplaced) {
  int displaced = 0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    Site site(15, 0.06, seed);
    displaced += Count(
        Likeliest(site.positions(), site.Difference(0, Eigen::Vector2d::Zero()), site.cov(), {}));
  }
  EXPECT_LE(displaced, 15);  // Of 3,000.
}

TEST(FindDisplaced, TellsTheFewThatMovedFromTheManyThatStayed) {
  int right = 0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    Site site(15, 0.06, seed);
    const std::vector<int> found =
        Likeliest(site.positions(), site.Difference(4, {0.4, 0.0}), site.cov(), {});
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
    right += Count(Likeliest(site.positions(), difference, too_large, {})) == 4;
  }
  EXPECT_GE(right, 45);
}

TEST(FindDisplaced, CovariancesHalfAsLargeAsTheErrorsDisplaceLittle) {
  int displaced = 0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    Site site(15, 0.06, seed);
    const DifferenceCovariance too_small = site.CovarianceOff(0.25, 0.25);
    displaced +=
        Count(Likeliest(
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
        Count(Likeliest(site.positions(), site.Difference(4, {0.2, 0.0}), site.cov(), {})) == 4;
    Site other(15, 0.06, seed);
    alone +=
        Count(Likeliest(other.positions(), other.Difference(1, {0.2, 0.0}), other.cov(), {})) == 1;
  }
  EXPECT_GT(together, alone);
}

// Among many landmarks some are always off to one side.
TEST(FindDisplaced, NoiseOfManyLandmarksIsNoDisplacement) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    Site site(150, 0.06, seed);
    const Eigen::VectorXd noise = site.Difference(0, Eigen::Vector2d::Zero());
    EXPECT_LE(Count(Likeliest(site.positions(), noise, site.cov(), {})), 2) << seed;
    Site changed(150, 0.06, seed);
    const std::vector<int> found =
        Likeliest(changed.positions(), changed.Difference(6, {0.6, 0.3}), changed.cov(), {});
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
    displaced += Likeliest(site.positions(), difference, cov, {})[9] >= 0;
  }
  EXPECT_LE(displaced, 10);
}

TEST(FindDisplaced, NoLandmarksAreNoClusters) {
  EXPECT_TRUE(Likeliest({}, Eigen::VectorXd(), {}, {}).empty());
}

}  // namespace
}  // namespace shiftmap

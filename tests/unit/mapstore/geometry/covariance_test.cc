// SPDX-License-Identifier: Apache-2.0
#include "mapstore/geometry/covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

TEST(IsSymmetricPositiveDefiniteTest, TellsMatricesApart) {
  Eigen::Matrix3d matrix = Eigen::Vector3d(1.0, 2.0, 3.0).asDiagonal();
  EXPECT_TRUE(IsSymmetricPositiveDefinite(matrix));
  EXPECT_FALSE(IsSymmetricPositiveDefinite(matrix, 1.5));
  matrix(0, 1) = 1e-3;
  EXPECT_FALSE(IsSymmetricPositiveDefinite(matrix));
  matrix = Eigen::Vector3d(1.0, 2.0, -1e-9).asDiagonal();
  EXPECT_FALSE(IsSymmetricPositiveDefinite(matrix));
  matrix(0, 0) = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(IsSymmetricPositiveDefinite(matrix));
  EXPECT_FALSE(IsSymmetricPositiveDefinite(Eigen::MatrixXd(2, 3)));
  EXPECT_FALSE(IsSymmetricPositiveDefinite(Eigen::MatrixXd(0, 0)));
}

TEST(IsSymmetricPositiveDefiniteTest, TwoByTwoAgreesWithTheEigenvalues) {
  std::mt19937_64 random(TestSeed(5));
  std::normal_distribution<double> normal;
  int positive = 0;
  for (int i = 0; i < 2000; ++i) {
    Eigen::Matrix2d matrix = Eigen::Matrix2d::NullaryExpr([&] { return normal(random); });
    matrix = 0.5 * (matrix + matrix.transpose()).eval();
    matrix.diagonal().array() += 0.5;
    const double smallest =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(matrix).eigenvalues().minCoeff();
    for (const double bound : {0.0, 0.3}) {
      if (std::abs(smallest - bound) < 1e-12) continue;
      EXPECT_EQ(IsSymmetricPositiveDefinite(matrix, bound), smallest > bound) << matrix;
    }
    if (smallest > 0.0) ++positive;
  }
  EXPECT_GT(positive, 200);
  EXPECT_LT(positive, 1800);
}

TEST(LargestSdTest, IsTheRootOfTheLargestEigenvalue) {
  std::mt19937_64 random(TestSeed(6));
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const Eigen::Matrix2d root = Eigen::Matrix2d::NullaryExpr([&] { return normal(random); });
    const Eigen::Matrix2d cov = root * root.transpose();
    const double largest =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(cov).eigenvalues().maxCoeff();
    EXPECT_NEAR(LargestSd(cov), std::sqrt(largest), 1e-12) << cov;
  }
  EXPECT_EQ(LargestSd(Eigen::Matrix2d::Zero()), 0.0);
}

TEST(LogGaussianTest, IntegratesToOne) {
  Eigen::Matrix2d S;
  S << 0.5, 0.2, 0.2, 0.3;
  constexpr double kStep = 0.05;
  double integral = 0.0;
  for (double x = -6.0; x < 6.0; x += kStep) {
    for (double y = -6.0; y < 6.0; y += kStep) {
      integral += std::exp(LogGaussian({x, y}, S)) * kStep * kStep;
    }
  }
  EXPECT_NEAR(integral, 1.0, 1e-9);
  EXPECT_DOUBLE_EQ(LogGaussian({0.0, 0.0}, Eigen::Matrix2d::Identity()),
                   -std::log(2.0 * std::numbers::pi));
}

TEST(SquaredMahalanobisTest, ByHand) {
  const Eigen::Matrix2d S = Eigen::Vector2d(4.0, 0.25).asDiagonal();
  EXPECT_DOUBLE_EQ(SquaredMahalanobis({2.0, 1.0}, S), 5.0);
}

TEST(SquaredMahalanobisTest, PosesByHand) {
  const Se2 T_map_a(3.0, -1.0, std::numbers::pi / 2.0);
  const Eigen::Matrix3d cov = Eigen::Vector3d(4.0, 0.25, 0.01).asDiagonal();
  // Two metres ahead, one to the left: along y and -x of the map.
  EXPECT_NEAR(SquaredMahalanobis(T_map_a, Se2(2.0, 1.0, T_map_a.yaw()), cov), 5.0, 1e-12);
  EXPECT_NEAR(SquaredMahalanobis(T_map_a, Se2(3.0, -1.0, T_map_a.yaw() - 0.2), cov), 4.0, 1e-12);
}

// The covariance goes along from the one frame to the other by the adjoint.
TEST(SquaredMahalanobisTest, PosesAreAsFarFromEachOtherFromBothSides) {
  std::mt19937_64 random(TestSeed(7));
  std::normal_distribution<double> normal;
  const auto draw = [&] { return normal(random); };
  for (int i = 0; i < 200; ++i) {
    const Se2 T_map_a = Se2::Exp(Eigen::Vector3d::NullaryExpr(draw));
    const Se2 T_a_b = Se2::Exp(0.5 * Eigen::Vector3d::NullaryExpr(draw));
    const Eigen::Matrix3d root = Eigen::Matrix3d::NullaryExpr(draw);
    const Eigen::Matrix3d cov = root * root.transpose() + 0.1 * Eigen::Matrix3d::Identity();
    const Eigen::Matrix3d adjoint = T_a_b.InverseAdjoint();
    const double squared = SquaredMahalanobis(T_map_a, T_map_a * T_a_b, cov);
    EXPECT_NEAR(SquaredMahalanobis(T_map_a * T_a_b, T_map_a, adjoint * cov * adjoint.transpose()),
                squared,
                1e-6 * squared);
  }
}

// Also over yaw, as the covariance of T·Exp(ξ) has it.
TEST(SquaredMahalanobisTest, PosesDrawnFromTheCovarianceAreChiSquareWithThreeDegreesOfFreedom) {
  std::mt19937_64 random(TestSeed(8));
  std::normal_distribution<double> normal;
  const Eigen::Matrix3d root =
      (Eigen::Matrix3d() << 0.5, 0.0, 0.0, 0.2, 0.3, 0.0, -0.1, 0.2, 0.4).finished();
  const Se2 T_map_a(1.0, 2.0, 3.0);
  constexpr int kDraws = 20'000;
  double sum = 0.0;
  int outside = 0;
  for (int i = 0; i < kDraws; ++i) {
    const Eigen::Vector3d z = Eigen::Vector3d::NullaryExpr([&] { return normal(random); });
    const double squared =
        SquaredMahalanobis(T_map_a, T_map_a * Se2::Exp(root * z), root * root.transpose());
    sum += squared;
    outside += squared > ChiSquareQuantile(0.95, 3);
  }
  EXPECT_NEAR(sum / kDraws, 3.0, 4.0 * std::sqrt(6.0 / kDraws));
  EXPECT_NEAR(outside, 0.05 * kDraws, 4.0 * std::sqrt(0.05 * 0.95 * kDraws));
}

TEST(ChiSquareTest, TwoDegreesOfFreedomHaveAClosedForm) {
  for (const double probability : {0.05, 0.5, 0.95, 0.999}) {
    const double quantile = ChiSquareQuantile(probability, 2);
    EXPECT_NEAR(quantile, -2.0 * std::log(1.0 - probability), 1e-10);
    EXPECT_NEAR(ChiSquareTail(quantile, 2), 1.0 - probability, 1e-12);
  }
}

TEST(ChiSquareTest, TailTakesWhatIsNoSquare) {
  EXPECT_EQ(ChiSquareTail(0.0, 2), 1.0);
  EXPECT_EQ(ChiSquareTail(-1.0, 2), 1.0);
  EXPECT_EQ(ChiSquareTail(std::numeric_limits<double>::quiet_NaN(), 2), 0.0);
  EXPECT_EQ(ChiSquareTail(std::numeric_limits<double>::infinity(), 2), 0.0);
}

TEST(SymmetrizedTest, AveragesBothHalves) {
  Eigen::Matrix2d matrix;
  matrix << 1.0, 2.0, 4.0, 5.0;
  EXPECT_EQ(Symmetrized(matrix)(0, 1), 3.0);
  EXPECT_EQ(Symmetrized(matrix)(1, 0), 3.0);
}

}  // namespace
}  // namespace shiftmap::testing

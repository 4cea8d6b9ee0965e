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

TEST(ChiSquareTest, TwoDegreesOfFreedomHaveAClosedForm) {
  for (const double probability : {0.05, 0.5, 0.95, 0.999}) {
    const double quantile = ChiSquareQuantile(probability, 2);
    EXPECT_NEAR(quantile, -2.0 * std::log(1.0 - probability), 1e-10);
    EXPECT_NEAR(ChiSquareTail(quantile, 2), 1.0 - probability, 1e-12);
  }
}

TEST(SymmetrizedTest, AveragesBothHalves) {
  Eigen::Matrix2d matrix;
  matrix << 1.0, 2.0, 4.0, 5.0;
  EXPECT_EQ(Symmetrized(matrix)(0, 1), 3.0);
  EXPECT_EQ(Symmetrized(matrix)(1, 0), 3.0);
}

}  // namespace
}  // namespace shiftmap::testing

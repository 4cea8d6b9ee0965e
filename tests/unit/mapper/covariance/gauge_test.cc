// SPDX-License-Identifier: Apache-2.0
#include "mapper/covariance/gauge.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <random>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using Positions = std::vector<Eigen::Vector2d>;

constexpr double kFloorVariance = 1e-6;  // What ReferToPositions adds per axis. [m²]

class Gauge : public ::testing::Test {
 protected:
  Positions RandomPositions(int count) { return testing::RandomPositions(random_, count, 10.0); }

  Eigen::MatrixXd RandomJointCovariance(int count, double sd) {
    Eigen::MatrixXd root(2 * count, 2 * count);
    for (double& value : root.reshaped()) value = sd * normal_(random_);
    return root * root.transpose() / (2.0 * count);
  }

  std::mt19937_64 random_{testing::TestSeed(51)};
  std::normal_distribution<double> normal_;
};

// S-transformation of surveying: errors as they are in the frame that position `a` and the
// direction from it to position `b` hold.
Eigen::MatrixXd ReferToPair(const Positions& positions,
                            std::size_t a,
                            std::size_t b,
                            const Eigen::MatrixXd& cov) {
  const Eigen::MatrixXd G = GaugeDirections(positions);
  const Eigen::Vector2d along = (positions[b] - positions[a]).normalized();
  const Eigen::Vector2d across(-along.y(), along.x());
  // Three conditions B e = 0 that fix the frame.
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(3, cov.cols());
  B(0, static_cast<Eigen::Index>(2 * a)) = 1.0;
  B(1, static_cast<Eigen::Index>(2 * a + 1)) = 1.0;
  B.block<1, 2>(2, static_cast<Eigen::Index>(2 * b)) = across.transpose();
  const Eigen::MatrixXd S =
      Eigen::MatrixXd::Identity(cov.rows(), cov.cols()) - G * (B * G).partialPivLu().solve(B);
  return S * cov * S.transpose();
}

TEST_F(Gauge, ReferringForgetsWhereTheFrameWasHeld) {
  const Positions positions = RandomPositions(7);
  const Eigen::MatrixXd cov = RandomJointCovariance(7, 0.1);
  const Eigen::MatrixXd direct = ReferToPositions(positions, cov);
  for (std::size_t a = 0; a < 3; ++a) {
    const Eigen::MatrixXd held = ReferToPair(positions, a, a + 3, cov);
    EXPECT_NEAR(
        held(static_cast<Eigen::Index>(2 * a), static_cast<Eigen::Index>(2 * a)), 0.0, 1e-12);
    EXPECT_THAT(ReferToPositions(positions, held), testing::IsNearMatrix(direct, 1e-10)) << a;
  }
}

TEST_F(Gauge, NoPairOfPositionsHoldsTheFrameWithLessTrace) {
  const Positions positions = RandomPositions(7);
  const Eigen::MatrixXd cov = RandomJointCovariance(7, 0.1);
  const double trace =
      ReferToPositions(positions, cov).trace() - kFloorVariance * static_cast<double>(cov.rows());
  for (std::size_t a = 0; a < positions.size(); ++a) {
    for (std::size_t b = 0; b < positions.size(); ++b) {
      if (a == b) continue;
      EXPECT_LE(trace, ReferToPair(positions, a, b, cov).trace() + 1e-12);
    }
  }
}

TEST_F(Gauge, ReferredCovarianceIsPositiveDefinite) {
  const Positions positions = RandomPositions(5);
  const Eigen::MatrixXd cov = ReferToPositions(positions, RandomJointCovariance(5, 0.1));
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(cov);
  EXPECT_GT(solver.eigenvalues()[0], 0.9 * kFloorVariance);
}

TEST_F(Gauge, ScaleMovesPositionsByTheirOffset) {
  const Positions positions = {{0.0, 0.0}, {10.0, 0.0}, {0.0, 10.0}, {10.0, 10.0}};
  const Eigen::MatrixXd cov = AddScaleUncertainty(positions, 0.02, Eigen::MatrixXd::Zero(8, 8));
  // Every corner is (±5, ±5) from the centroid.
  EXPECT_NEAR(cov(0, 0), 0.01, 1e-12);
  EXPECT_NEAR(cov(0, 2), -0.01, 1e-12);
  // The distance between two corners is uncertain by 2 %.
  const Eigen::VectorXd d = Eigen::VectorXd::Unit(8, 2) - Eigen::VectorXd::Unit(8, 0);
  EXPECT_NEAR(d.dot(cov * d), 0.2 * 0.2, 1e-12);
  // It is no motion of the frame.
  EXPECT_NEAR((GaugeDirections(positions).transpose() * cov).norm(), 0.0, 1e-12);
}

// A map whose newest positions have joined those that hold its frame: where that was held must not
// pass for knowledge of the newest ones.
TEST_F(Gauge, PriorForgetsWhereTheFrameWasHeld) {
  const Positions positions = RandomPositions(7);
  const Eigen::MatrixXd cov = RandomJointCovariance(7, 0.1);
  const Eigen::MatrixXd held =
      ReferToPair(positions, 0, 3, cov) + 1e-10 * Eigen::MatrixXd::Identity(14, 14);
  const std::vector<ModeIndex> modes = {0, 1, 2, 3, 4, 5, 6};
  const auto information = [&](const Eigen::MatrixXd& of) -> Eigen::MatrixXd {
    const GraphPrior prior = MakeGraphPrior(modes, positions, of);
    return prior.sqrt_information.transpose() * prior.sqrt_information;
  };
  const Eigen::MatrixXd expected = information(cov);
  EXPECT_LT((information(held) - expected).norm(), 1e-3 * expected.norm());
}

TEST_F(Gauge, PriorHasTheInformationOfTheCovarianceItWasMadeFrom) {
  const Positions positions = RandomPositions(6);
  Eigen::MatrixXd cov = ReferToPositions(positions, RandomJointCovariance(6, 0.1));
  const GraphPrior prior = MakeGraphPrior({5, 4, 3, 2, 1, 0}, positions, cov);
  EXPECT_EQ(prior.modes, (std::vector<ModeIndex>{5, 4, 3, 2, 1, 0}));
  EXPECT_EQ(prior.mean.segment<2>(6), positions[3]);
  const Eigen::MatrixXd information = prior.sqrt_information.transpose() * prior.sqrt_information;
  const Eigen::MatrixXd back = information.llt().solve(Eigen::MatrixXd::Identity(12, 12));
  EXPECT_THAT(ReferToPositions(positions, back), testing::IsNearMatrix(cov, 2e-6));
  // The frame is held: a rigid motion of a centimetre costs many standard deviations.
  const Eigen::MatrixXd G = GaugeDirections(positions);
  for (Eigen::Index column = 0; column < 3; ++column) {
    EXPECT_GT((prior.sqrt_information * 0.01 * G.col(column)).norm(), 50.0);
  }
}

}  // namespace
}  // namespace shiftmap

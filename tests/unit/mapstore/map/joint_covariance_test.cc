// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/joint_covariance.h"

#include <gtest/gtest.h>

#include "tests/support/geometry_matchers.h"

namespace shiftmap::testing {
namespace {

TEST(JointCovarianceTest, DenseRoundTrip) {
  Eigen::MatrixXd root = Eigen::MatrixXd::Random(10, 10);
  Eigen::MatrixXd dense = root * root.transpose();
  dense = 0.5 * (dense + dense.transpose()).eval();
  dense.block<2, 2>(2, 6).setZero();
  dense.block<2, 2>(6, 2).setZero();
  const JointCovariance covariance = JointCovariance::FromDense(dense);
  EXPECT_EQ(covariance.size(), 5);
  EXPECT_EQ(covariance.cross_blocks().size(), 9u);
  EXPECT_THAT(covariance.Dense(), IsNearMatrix(dense, 0.0));
  for (int row = 0; row < 5; ++row) {
    for (int column = 0; column < 5; ++column) {
      const Eigen::Matrix2d expected =
          dense.block<2, 2>(Eigen::Index{2} * row, Eigen::Index{2} * column);
      EXPECT_EQ(covariance.Block(row, column), expected) << row << ", " << column;
    }
  }
}

TEST(JointCovarianceTest, EmptyAndWithoutCrossBlocks) {
  EXPECT_EQ(JointCovariance().size(), 0);
  EXPECT_EQ(JointCovariance::FromDense(Eigen::MatrixXd(0, 0)).size(), 0);
  const JointCovariance covariance({Eigen::Matrix2d::Identity(), 2.0 * Eigen::Matrix2d::Identity()},
                                   {});
  EXPECT_EQ(covariance.Block(0, 1), Eigen::Matrix2d::Zero());
  EXPECT_EQ(covariance.Block(1, 1)(0, 0), 2.0);
}

TEST(JointCovarianceTest, ComponentsAreWhatBlocksConnect) {
  const Eigen::Matrix2d one = Eigen::Matrix2d::Identity();
  const std::vector<Eigen::Matrix2d> diagonal(7, one);
  // 1 - 4 - 6 by way of 4, 2 - 3, and 0 and 5 alone.
  const JointCovariance cov(diagonal, {{4, 6, 0.1 * one}, {1, 4, 0.2 * one}, {2, 3, 0.3 * one}});
  EXPECT_EQ(cov.Components(), (std::vector<std::vector<int>>{{0}, {1, 4, 6}, {2, 3}, {5}}));
  EXPECT_TRUE(JointCovariance().Components().empty());
}

TEST(JointCovarianceTest, DenseOfSomeModesIsPartOfTheWhole) {
  const Eigen::MatrixXd root = Eigen::MatrixXd::Random(10, 10);
  const JointCovariance cov = JointCovariance::FromDense(root * root.transpose());
  const Eigen::MatrixXd some = cov.Dense({3, 0});
  EXPECT_EQ(some, cov.Dense()({6, 7, 0, 1}, {6, 7, 0, 1}));
}

TEST(JointCovarianceDeathTest, BlocksMustBeAboveTheDiagonalAndOnce) {
  const Eigen::Matrix2d zero = Eigen::Matrix2d::Zero();
  const std::vector<Eigen::Matrix2d> diagonal(3, Eigen::Matrix2d::Identity());
  EXPECT_DEATH(JointCovariance(diagonal, {{1, 1, zero}}), "block \\(1, 1\\) of 3 modes");
  EXPECT_DEATH(JointCovariance(diagonal, {{0, 3, zero}}), "block \\(0, 3\\) of 3 modes");
  EXPECT_DEATH(JointCovariance(diagonal, {{0, 1, zero}, {0, 1, zero}}), "block \\(0, 1\\) twice");
  EXPECT_DEATH(JointCovariance(diagonal, {}).Block(0, 3), "of 3 modes");
}

}  // namespace
}  // namespace shiftmap::testing

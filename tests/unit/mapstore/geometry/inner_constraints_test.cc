// SPDX-License-Identifier: Apache-2.0
#include "mapstore/geometry/inner_constraints.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using Positions = std::vector<Eigen::Vector2d>;

class InnerConstraints : public ::testing::Test {
 protected:
  Positions RandomPositions(int count) { return testing::RandomPositions(random_, count, 10.0); }

  std::mt19937_64 random_{testing::TestSeed(52)};
};

TEST_F(InnerConstraints, DirectionsAreOrthonormalAndRigid) {
  const Positions positions = RandomPositions(6);
  const Eigen::MatrixXd G = GaugeDirections(positions);
  EXPECT_THAT((G.transpose() * G).eval(),
              testing::IsNearMatrix(Eigen::Matrix3d::Identity().eval(), 1e-12));
  // Along each of them all distances stay, to first order.
  for (Eigen::Index column = 0; column < 3; ++column) {
    for (std::size_t i = 1; i < positions.size(); ++i) {
      const Eigen::Vector2d moved =
          G.col(column).segment<2>(static_cast<Eigen::Index>(2 * i)) - G.col(column).head<2>();
      EXPECT_NEAR(moved.dot(positions[i] - positions[0]), 0.0, 1e-12);
    }
  }
}

TEST_F(InnerConstraints, OnePositionHasNoRotation) {
  const Eigen::MatrixXd G = GaugeDirections({Eigen::Vector2d(3.0, 4.0)});
  EXPECT_EQ(G.col(2).norm(), 0.0);
}

TEST_F(InnerConstraints, GrowthIsNoMotionOfTheFrame) {
  const Positions positions = RandomPositions(6);
  const Eigen::VectorXd q = OffsetsFromCentroid(positions);
  EXPECT_NEAR((GaugeDirections(positions).transpose() * q).norm(), 0.0, 1e-12 * q.norm());
}

TEST_F(InnerConstraints, BlocksAreThoseOfTheProjectedCovariance) {
  const Positions positions = RandomPositions(5);
  Eigen::MatrixXd root(10, 10);
  std::normal_distribution<double> normal;
  for (double& value : root.reshaped()) value = normal(random_);
  const Eigen::MatrixXd P = root * root.transpose();
  const Eigen::MatrixXd G = GaugeDirections(positions);
  const Eigen::MatrixXd projector = Eigen::MatrixXd::Identity(10, 10) - G * G.transpose();
  const Eigen::MatrixXd expected = projector * P * projector;
  const STransformation change(G, P * G);
  for (int a = 0; a < 5; ++a) {
    for (int b = 0; b < 5; ++b) {
      EXPECT_THAT(change.Refer(a, b, P.block<2, 2>(2 * a, 2 * b)),
                  testing::IsNearMatrix(expected.block<2, 2>(2 * a, 2 * b).eval(), 1e-11));
    }
  }
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/covariance/map_prior.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <random>

#include "mapper/covariance/gauge.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using Positions = std::vector<Eigen::Vector2d>;

class MapPrior : public ::testing::Test {
 protected:
  Positions RandomPositions(int count) { return testing::RandomPositions(random_, count, 20.0); }

  // Of centimetres, relative to the positions as a whole.
  Eigen::MatrixXd ShapeCovariance(const Positions& positions) {
    const std::ptrdiff_t size = 2 * std::ssize(positions);
    Eigen::MatrixXd root(size, size);
    for (double& value : root.reshaped()) value = 0.03 * normal_(random_);
    return ReferToPositions(positions, root * root.transpose() / static_cast<double>(size));
  }

  // Blocks of neighbours in order; zero between them.
  static JointCovariance InTiles(const Eigen::MatrixXd& dense, int modes_per_tile) {
    Eigen::MatrixXd blocks = Eigen::MatrixXd::Zero(dense.rows(), dense.cols());
    const Eigen::Index rows = Eigen::Index{2} * modes_per_tile;
    for (Eigen::Index at = 0; at < dense.rows(); at += rows) {
      const Eigen::Index size = std::min(rows, dense.rows() - at);
      blocks.block(at, at, size, size) = dense.block(at, at, size, size);
    }
    return JointCovariance::FromDense(blocks);
  }

  std::mt19937_64 random_{testing::TestSeed(77)};
  std::normal_distribution<double> normal_;
};

TEST_F(MapPrior, ASmallMapIsOneGaussianThatHoldsTheFrame) {
  const Positions positions = RandomPositions(10);
  const Eigen::MatrixXd cov = ShapeCovariance(positions);
  const std::vector<GraphPrior> priors = MakeMapPrior(positions, JointCovariance::FromDense(cov));
  ASSERT_EQ(priors.size(), 1u);
  EXPECT_EQ(priors[0].modes, (std::vector<ModeIndex>{0, 1, 2, 3, 4, 5, 6, 7, 8, 9}));
  const Eigen::MatrixXd back = priors[0].information.inverse();
  EXPECT_THAT(ReferToPositions(positions, back), testing::IsNearMatrix(cov, 2e-6));
  EXPECT_TRUE(MakeMapPrior({}, JointCovariance()).empty());
}

TEST_F(MapPrior, ALargeMapIsAGaussianForEachTile) {
  constexpr int kTile = 60;
  const Positions positions = RandomPositions(kMaxJointModes + 30);
  const JointCovariance cov = InTiles(ShapeCovariance(positions), kTile);
  const std::vector<GraphPrior> priors = MakeMapPrior(positions, cov);
  ASSERT_EQ(priors.size(), 6u);
  ModeIndex first;
  for (const GraphPrior& prior : priors) {
    EXPECT_EQ(prior.modes.front(), first);
    EXPECT_EQ(prior.mean.head<2>(), positions[static_cast<std::size_t>(first.value())]);
    std::vector<int> rows;
    for (const ModeIndex mode : prior.modes) rows.push_back(mode.value());
    first = prior.modes.back() + 1;
    const Eigen::MatrixXd of_tile = cov.Dense(rows);
    EXPECT_THAT(prior.information.inverse(), testing::IsNearMatrix(of_tile, 1e-9));
    EXPECT_THAT(prior.sqrt_information.transpose() * prior.sqrt_information,
                testing::IsNearMatrix(prior.information, 1e-9 * prior.information.norm()));
  }
  EXPECT_EQ(first, ModeIndex(positions.size()));
}

}  // namespace
}  // namespace shiftmap

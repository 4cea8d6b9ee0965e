// SPDX-License-Identifier: Apache-2.0
#include "mapper/covariance/map_prior.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <random>

#include "mapper/covariance/gauge.h"
#include "mapper/covariance/mode_covariance.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using Positions = std::vector<Eigen::Vector2d>;

constexpr double kSdScale = 0.02;

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

  // A map of one mode a landmark.
  static MapContent MapOf(const Positions& positions, JointCovariance cov) {
    MapContent content;
    for (std::size_t i = 0; i < positions.size(); ++i) {
      const auto mode = static_cast<int>(i);
      LandmarkGroup group;
      group.signature = Signature(fmt::format("L{:04}", i));
      group.modes.push_back({ModeNumber(1), positions[i], cov.Block(mode, mode), Stamp()});
      content.groups.push_back(std::move(group));
    }
    content.covariance = std::move(cov);
    return content;
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

TEST_F(MapPrior, ScaleIsTakenOutAsItWasAdded) {
  const Positions positions = RandomPositions(40);
  const Eigen::MatrixXd shape = ShapeCovariance(positions);
  MapContent content =
      MapOf(positions, JointCovariance::FromDense(AddScaleUncertainty(positions, kSdScale, shape)));
  // What the shape says of the scale by itself goes with it, hundredths of a percent.
  EXPECT_NEAR(RemoveScale(kSdScale, &content), kSdScale, 1e-4);
  const Eigen::VectorXd q = OffsetsFromCentroid(positions);
  EXPECT_LT((content.covariance.Dense() - shape).norm(), 1e-2 * (q * q.transpose()).norm() * 1e-4);
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(content.covariance.Dense())
                .eigenvalues()
                .minCoeff(),
            0.0);
  EXPECT_EQ(content.groups[3].modes[0].cov_p_map_landmark, content.covariance.Block(3, 3));
}

// Runs of several vehicles leave more than what their sensors have in common.
TEST_F(MapPrior, AllOfTheScaleIsTakenOut) {
  const Positions positions = RandomPositions(40);
  MapContent content = MapOf(positions,
                             JointCovariance::FromDense(AddScaleUncertainty(
                                 positions, 1.5 * kSdScale, ShapeCovariance(positions))));
  EXPECT_NEAR(RemoveScale(kSdScale, &content), 1.5 * kSdScale, 1e-4);
  // Once it is taken out there is none left.
  const JointCovariance once = content.covariance;
  EXPECT_EQ(RemoveScale(kSdScale, &content), 0.0);
  EXPECT_EQ(content.covariance.Dense(), once.Dense());
}

TEST_F(MapPrior, ASurveyKnowsItsScaleAndStaysAsItIs) {
  for (const int landmarks : {15, kMaxJointModes + 20}) {
    const Positions positions = RandomPositions(landmarks);
    const Eigen::MatrixXd cov =
        0.05 * 0.05 *
        Eigen::MatrixXd::Identity(std::ssize(positions) * 2, std::ssize(positions) * 2);
    MapContent content = MapOf(positions, JointCovariance::FromDense(cov));
    EXPECT_EQ(RemoveScale(kSdScale, &content), 0.0);
    EXPECT_EQ(content.covariance.Dense(), cov);
  }
}

TEST_F(MapPrior, TheTilesOfALargeMapHaveOneScale) {
  constexpr int kTile = 60;
  const Positions positions = RandomPositions(kMaxJointModes + 60);
  const Eigen::MatrixXd shape = ShapeCovariance(positions);
  MapContent content =
      MapOf(positions, InTiles(AddScaleUncertainty(positions, kSdScale, shape), kTile));
  const double sd = RemoveScale(kSdScale, &content);
  EXPECT_GE(sd, (1.0 - 1e-6) * kSdScale);
  const Eigen::MatrixXd left = content.covariance.Dense();
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(left).eigenvalues().minCoeff(), 0.0);
  const Eigen::MatrixXd expected =
      InTiles(AddScaleUncertainty(positions, kSdScale, shape), kTile).Dense() -
      InTiles(AddScaleUncertainty(positions, sd, Eigen::MatrixXd::Zero(shape.rows(), shape.cols())),
              kTile)
          .Dense();
  EXPECT_LT((left - expected).norm(), 1e-9 * expected.norm());
}

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

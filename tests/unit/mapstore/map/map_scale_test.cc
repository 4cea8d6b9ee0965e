// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/map_scale.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <random>
#include <vector>

#include "mapstore/geometry/inner_constraints.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using Positions = std::vector<Eigen::Vector2d>;

constexpr double kSdScale = 0.02;

class MapScaleTest : public ::testing::Test {
 protected:
  Positions RandomPositions(int count) { return testing::RandomPositions(random_, count, 20.0); }

  // Of centimetres.
  Eigen::MatrixXd ShapeCovariance(const Positions& positions) {
    const std::ptrdiff_t size = 2 * std::ssize(positions);
    Eigen::MatrixXd root(size, size);
    for (double& value : root.reshaped()) value = 0.03 * normal_(random_);
    return root * root.transpose() / static_cast<double>(size) +
           1e-6 * Eigen::MatrixXd::Identity(size, size);
  }

  static Eigen::MatrixXd ScaleCovariance(const Positions& positions, double sd) {
    const Eigen::VectorXd q = OffsetsFromCentroid(positions);
    return sd * sd * q * q.transpose();
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

  static double SmallestEigenvalue(const Eigen::MatrixXd& cov) {
    return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(cov).eigenvalues().minCoeff();
  }

  std::mt19937_64 random_{testing::TestSeed(77)};
  std::normal_distribution<double> normal_;
};

TEST_F(MapScaleTest, IsRemovedAsItWasAdded) {
  const Positions positions = RandomPositions(40);
  const Eigen::MatrixXd shape = ShapeCovariance(positions);
  const Eigen::MatrixXd cov = shape + ScaleCovariance(positions, kSdScale);
  MapContent content = MapOf(positions, JointCovariance::FromDense(cov));
  // What the shape says of the scale by itself goes with it, hundredths of a percent.
  const MapScale scale = RemoveScale(kSdScale, &content);
  EXPECT_NEAR(scale.sd, kSdScale, 1e-4);
  EXPECT_EQ(scale.p_map_centroid, Centroid(positions));
  const Eigen::MatrixXd left = content.covariance.Dense();
  EXPECT_LT((left - shape).norm(), 1e-6 * ScaleCovariance(positions, 1.0).norm());
  EXPECT_LT((left + ScaleCovariance(positions, scale.sd) - cov).norm(), 1e-9 * cov.norm());
  EXPECT_GT(SmallestEigenvalue(left), 0.0);
  EXPECT_EQ(content.groups[3].modes[0].cov_p_map_landmark, content.covariance.Block(3, 3));
}

// Runs of several vehicles leave more than what their sensors have in common.
TEST_F(MapScaleTest, AllOfItIsRemoved) {
  const Positions positions = RandomPositions(40);
  MapContent content =
      MapOf(positions,
            JointCovariance::FromDense(ShapeCovariance(positions) +
                                       ScaleCovariance(positions, 1.5 * kSdScale)));
  EXPECT_NEAR(RemoveScale(kSdScale, &content).sd, 1.5 * kSdScale, 1e-4);
  // Once it is removed there is none left.
  const JointCovariance once = content.covariance;
  EXPECT_EQ(RemoveScale(kSdScale, &content).sd, 0.0);
  EXPECT_EQ(content.covariance.Dense(), once.Dense());
}

TEST_F(MapScaleTest, ASurveyKnowsItsScaleAndStaysAsItIs) {
  for (const int landmarks : {15, kMaxJointModes + 20}) {
    const Positions positions = RandomPositions(landmarks);
    const Eigen::MatrixXd cov =
        0.05 * 0.05 *
        Eigen::MatrixXd::Identity(std::ssize(positions) * 2, std::ssize(positions) * 2);
    MapContent content = MapOf(positions, JointCovariance::FromDense(cov));
    EXPECT_EQ(RemoveScale(kSdScale, &content).sd, 0.0);
    EXPECT_EQ(content.covariance.Dense(), cov);
  }
}

TEST_F(MapScaleTest, TheTilesOfALargeMapHaveOne) {
  constexpr int kTile = 60;
  const Positions positions = RandomPositions(kMaxJointModes + 60);
  const Eigen::MatrixXd cov = ShapeCovariance(positions) + ScaleCovariance(positions, kSdScale);
  MapContent content = MapOf(positions, InTiles(cov, kTile));
  const double sd = RemoveScale(kSdScale, &content).sd;
  EXPECT_GE(sd, (1.0 - 1e-6) * kSdScale);
  const Eigen::MatrixXd left = content.covariance.Dense();
  EXPECT_GT(SmallestEigenvalue(left), 0.0);
  const Eigen::MatrixXd expected =
      InTiles(cov, kTile).Dense() - InTiles(ScaleCovariance(positions, sd), kTile).Dense();
  EXPECT_LT((left - expected).norm(), 1e-9 * expected.norm());
}

TEST_F(MapScaleTest, OfAMapWithoutLandmarksIsNone) {
  MapContent content;
  EXPECT_EQ(RemoveScale(kSdScale, &content).sd, 0.0);
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/control_points.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <random>
#include <vector>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

// A map of four landmarks, one mode each, whose positions are known to some centimetres and
// correlated.
MapContent FourLandmarks(std::uint64_t seed) {
  std::mt19937_64 random(TestSeed(seed));
  std::normal_distribution<double> normal;
  Eigen::MatrixXd root(8, 8);
  for (double& value : root.reshaped()) value = 0.01 * normal(random);
  const Eigen::MatrixXd dense = root * root.transpose() + 1e-6 * Eigen::MatrixXd::Identity(8, 8);
  MapContent content;
  content.covariance = JointCovariance::FromDense(dense);
  for (int i = 0; i < 4; ++i) {
    LandmarkGroup group;
    group.signature = Signature(std::string("L") + static_cast<char>('1' + i));
    Mode mode;
    mode.number = ModeNumber(1);
    mode.p_map_landmark = {10.0 * std::cos(1.5 * i), 10.0 * std::sin(1.5 * i)};
    mode.cov_p_map_landmark = content.covariance.Block(i, i);
    group.modes = {mode};
    group.chain = ModeChain::Uniform(1, 1e-5);
    group.probabilities = Eigen::Vector2d(0.5, 0.5);
    content.groups.push_back(group);
  }
  return content;
}

Eigen::VectorXd PositionsOf(const MapContent& content) {
  Eigen::VectorXd positions(8);
  for (int i = 0; i < 4; ++i) {
    positions.segment<2>(2 * i) =
        content.groups[static_cast<std::size_t>(i)].modes[0].p_map_landmark;
  }
  return positions;
}

ControlPoint PointOn(const MapContent& content, int group, double dx, double dy, double sd_m) {
  const LandmarkGroup& of = content.groups[static_cast<std::size_t>(group)];
  return {of.signature, ModeNumber(1), of.modes[0].p_map_landmark + Eigen::Vector2d(dx, dy), sd_m};
}

TEST(ControlPointsTest, OnePointMovesTheFrameAndNothingElse) {
  const MapContent before = FourLandmarks(1);
  MapContent content = before;
  const Se2 moved = HoldControlPoints({PointOn(before, 2, 3.0, -4.0, 0.02)}, true, &content);
  EXPECT_EQ(moved.yaw(), 0.0);
  EXPECT_THAT(moved.translation(), IsNearMatrix(Eigen::Vector2d(3.0, -4.0), 1e-12));
  for (int i = 0; i < 4; ++i) {
    EXPECT_THAT(PositionsOf(content).segment<2>(2 * i) - PositionsOf(before).segment<2>(2 * i),
                IsNearMatrix(Eigen::Vector2d(3.0, -4.0), 1e-12));
  }
  EXPECT_THAT(content.covariance.Dense(), IsNearMatrix(before.covariance.Dense(), 0.0));
  EXPECT_THAT(ValidateMapContent(content), IsOk());
}

TEST(ControlPointsTest, PointsOfAMovedMapMoveItAsAWholeByAnyAngle) {
  const MapContent before = FourLandmarks(2);
  const Se2 T_new_old(100.0, -200.0, 2.5);
  std::vector<ControlPoint> points;
  for (const int i : {0, 1, 3}) {
    points.push_back(PointOn(before, i, 0.0, 0.0, 0.02));
    points.back().p_map_landmark = T_new_old * points.back().p_map_landmark;
  }
  MapContent content = before;
  const Se2 moved = HoldControlPoints(points, true, &content);
  EXPECT_NEAR(moved.yaw(), 2.5, 1e-9);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_THAT(content.groups[i].modes[0].p_map_landmark,
                IsNearMatrix(T_new_old * before.groups[i].modes[0].p_map_landmark, 1e-7));
  }
  EXPECT_THAT(ValidateMapContent(content), IsOk());
}

// The oracle: the Gaussian of the map with a frame of which nothing is known, conditioned on the
// points one after the other.
TEST(ControlPointsTest, ShapeIsConditionedAsAGaussianWithAFreeFrame) {
  const MapContent before = FourLandmarks(3);
  const std::vector<ControlPoint> points = {PointOn(before, 0, 0.010, 0.004, 0.006),
                                            PointOn(before, 1, -0.008, 0.012, 0.010),
                                            PointOn(before, 3, 0.002, -0.016, 0.008)};
  MapContent content = before;
  HoldControlPoints(points, true, &content);

  constexpr double kFreeSd = 10.0;
  Eigen::VectorXd mean = PositionsOf(before);
  Eigen::MatrixXd G(8, 3);
  for (int i = 0; i < 4; ++i) {
    G.block<2, 2>(2 * i, 0).setIdentity();
    G.block<2, 1>(2 * i, 2) << -mean(2 * i + 1), mean(2 * i);
  }
  Eigen::MatrixXd cov = before.covariance.Dense() + kFreeSd * kFreeSd * G * G.transpose();
  const int of_point[] = {0, 1, 3};
  for (std::size_t k = 0; k < points.size(); ++k) {
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(2, 8);
    H.block<2, 2>(0, 2 * of_point[k]).setIdentity();
    const Eigen::Matrix2d S =
        H * cov * H.transpose() + points[k].sd_m * points[k].sd_m * Eigen::Matrix2d::Identity();
    const Eigen::MatrixXd K = cov * H.transpose() * S.inverse();
    mean += K * (points[k].p_map_landmark - H * mean);
    cov -= K * H * cov;
  }
  // The frame turns by some milliradian, of which the oracle has the first order only.
  EXPECT_THAT(PositionsOf(content), IsNearMatrix(mean, 2e-4));
  EXPECT_THAT(ValidateMapContent(content), IsOk());
  EXPECT_LT(content.covariance.Dense().trace(), before.covariance.Dense().trace());
}

TEST(ControlPointsTest, AMapThatKnowsOfThePointsKeepsItsCovariance) {
  const MapContent before = FourLandmarks(4);
  const std::vector<ControlPoint> points = {PointOn(before, 0, 0.0, 0.0, 0.03),
                                            PointOn(before, 1, 0.02, 0.0, 0.05)};
  MapContent content = before;
  const Se2 moved = HoldControlPoints(points, false, &content);
  const Eigen::Matrix2d R = moved.Rotation();
  EXPECT_THAT(content.covariance.Block(0, 3),
              IsNearMatrix(R * before.covariance.Block(0, 3) * R.transpose(), 1e-9));
}

TEST(ControlPointsTest, PointsTooCloseTogetherDoNotTurnTheMap) {
  MapContent before = FourLandmarks(5);
  before.groups[1].modes[0].p_map_landmark =
      before.groups[0].modes[0].p_map_landmark + Eigen::Vector2d(0.5, 0.0);
  const std::vector<ControlPoint> points = {PointOn(before, 0, 0.0, 0.05, 0.1),
                                            PointOn(before, 1, 0.0, -0.05, 0.1)};
  MapContent content = before;
  EXPECT_EQ(HoldControlPoints(points, true, &content).yaw(), 0.0);
}

TEST(ControlPointsTest, PointsOfUnknownModesSayNothing) {
  const MapContent before = FourLandmarks(6);
  MapContent content = before;
  ControlPoint other = PointOn(before, 0, 1.0, 1.0, 0.1);
  other.mode = ModeNumber(7);
  HoldControlPoints({other}, true, &content);
  EXPECT_EQ(GeometryHash(content), GeometryHash(before));
}

}  // namespace
}  // namespace shiftmap::testing

// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/control_points.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
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
  const Se2 moved = HoldControlPoints({PointOn(before, 2, 3.0, -4.0, 0.02)}, 0, &content);
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
  const Se2 moved = HoldControlPoints(points, 0, &content);
  EXPECT_NEAR(moved.yaw(), 2.5, 1e-9);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_THAT(content.groups[i].modes[0].p_map_landmark,
                IsNearMatrix(T_new_old * before.groups[i].modes[0].p_map_landmark, 1e-7));
  }
  EXPECT_THAT(ValidateMapContent(content), IsOk());
}

// The map that points which come one at a time give, and how its frame turned.
struct Held {
  MapContent content;
  double yaw_rad = 0.0;

  // In the directions of the map before.
  Eigen::MatrixXd Covariance() const {
    const Eigen::Matrix2d R = Se2(0.0, 0.0, yaw_rad).Rotation();
    Eigen::MatrixXd dense = content.covariance.Dense();
    for (Eigen::Index i = 0; i < dense.rows(); i += 2) {
      for (Eigen::Index k = 0; k < dense.cols(); k += 2) {
        dense.block<2, 2>(i, k) = R.transpose() * dense.block<2, 2>(i, k) * R;
      }
    }
    return dense;
  }
};

Held OneAtATime(const MapContent& before, const std::vector<ControlPoint>& points) {
  Held held{before};
  std::vector<ControlPoint> come;
  for (const ControlPoint& point : points) {
    come.push_back(point);
    held.yaw_rad += HoldControlPoints(come, come.size() - 1, &held.content).yaw();
  }
  return held;
}

Held AllAtOnce(const MapContent& before, const std::vector<ControlPoint>& points) {
  Held held{before};
  held.yaw_rad = HoldControlPoints(points, 0, &held.content).yaw();
  return held;
}

// The oracle: the Gaussian of the map and of a frame of which nothing is known, conditioned on the
// points one after the other.
TEST(ControlPointsTest, EachPointCountsOnceInAnyOrder) {
  const MapContent before = FourLandmarks(3);
  const std::vector<ControlPoint> points = {PointOn(before, 0, 0.010, 0.004, 0.006),
                                            PointOn(before, 1, -0.008, 0.012, 0.010),
                                            PointOn(before, 3, 0.002, -0.016, 0.008)};
  constexpr double kFreeSd = 10.0;
  const Eigen::VectorXd positions = PositionsOf(before);
  Eigen::MatrixXd G(8, 3);
  for (int i = 0; i < 4; ++i) {
    G.block<2, 2>(2 * i, 0).setIdentity();
    G.block<2, 1>(2 * i, 2) << -positions(2 * i + 1), positions(2 * i);
  }
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(11);
  mean.head<8>() = positions;
  Eigen::MatrixXd cov = kFreeSd * kFreeSd * Eigen::MatrixXd::Identity(11, 11);
  cov.topLeftCorner<8, 8>() = before.covariance.Dense();
  const int of_point[] = {0, 1, 3};
  for (std::size_t k = 0; k < points.size(); ++k) {
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(2, 11);
    H.block<2, 2>(0, 2 * of_point[k]).setIdentity();
    H.rightCols<3>() = G.middleRows<2>(2 * of_point[k]);
    const Eigen::Matrix2d S =
        H * cov * H.transpose() + points[k].sd_m * points[k].sd_m * Eigen::Matrix2d::Identity();
    const Eigen::MatrixXd K = cov * H.transpose() * S.inverse();
    mean += K * (points[k].p_map_landmark - H * mean);
    cov -= K * H * cov;
  }
  const Eigen::VectorXd expected = mean.head<8>() + G * mean.tail<3>();
  const Eigen::MatrixXd shape = cov.topLeftCorner<8, 8>();
  // The frame turns by some milliradian, of which the oracle has the first order only.
  const auto check = [&](const Held& held) {
    EXPECT_THAT(PositionsOf(held.content), IsNearMatrix(expected, 2e-4));
    EXPECT_THAT(held.Covariance(), IsNearMatrix(shape, 0.01 * shape.diagonal().minCoeff()));
    EXPECT_THAT(ValidateMapContent(held.content), IsOk());
  };
  check(AllAtOnce(before, points));
  std::vector<std::size_t> order = {0, 1, 2};
  do {
    check(OneAtATime(before, {points[order[0]], points[order[1]], points[order[2]]}));
  } while (std::next_permutation(order.begin(), order.end()));
}

// The first two do not tell the frame's rotation, and bend the map instead, until a third one does.
TEST(ControlPointsTest, PointsThatTellTheRotationTogetherOnlyAreAsIfTheyCameAtOnce) {
  MapContent before = FourLandmarks(10);
  before.groups[1].modes[0].p_map_landmark =
      before.groups[0].modes[0].p_map_landmark + Eigen::Vector2d(0.5, 0.0);
  std::vector<ControlPoint> points = {PointOn(before, 0, 0.00, 0.01, 0.03),
                                      PointOn(before, 1, 0.01, 0.00, 0.03),
                                      PointOn(before, 3, -0.01, 0.00, 0.03)};
  const Se2 T_new_old(3.0, -2.0, 0.1);
  for (ControlPoint& point : points) point.p_map_landmark = T_new_old * point.p_map_landmark;
  ASSERT_EQ(OneAtATime(before, {points[0], points[1]}).yaw_rad, 0.0);
  const Held once = AllAtOnce(before, points);
  const Held each = OneAtATime(before, points);
  EXPECT_NEAR(each.yaw_rad, 0.1, 0.01);
  EXPECT_NEAR(each.yaw_rad, once.yaw_rad, 1e-4);
  EXPECT_THAT(PositionsOf(each.content), IsNearMatrix(PositionsOf(once.content), 1e-3));
  const Eigen::MatrixXd expected = once.Covariance();
  EXPECT_THAT(each.Covariance(), IsNearMatrix(expected, 0.02 * expected.diagonal().minCoeff()));
}

TEST(ControlPointsTest, AMapThatKnowsOfThePointsIsMovedAsAWhole) {
  const MapContent before = FourLandmarks(4);
  const std::vector<ControlPoint> points = {PointOn(before, 0, 0.0, 0.0, 0.03),
                                            PointOn(before, 1, 0.02, 0.0, 0.05)};
  MapContent content = before;
  const Se2 moved = HoldControlPoints(points, points.size(), &content);
  EXPECT_GT(moved.translation().norm(), 1e-3);
  const Eigen::Matrix2d R = moved.Rotation();
  EXPECT_THAT(content.covariance.Block(0, 3),
              IsNearMatrix(R * before.covariance.Block(0, 3) * R.transpose(), 1e-9));
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_THAT(content.groups[i].modes[0].p_map_landmark,
                IsNearMatrix(moved * before.groups[i].modes[0].p_map_landmark, 1e-12));
  }
}

TEST(ControlPointsTest, PointsTooCloseTogetherDoNotTurnTheMap) {
  MapContent before = FourLandmarks(5);
  before.groups[1].modes[0].p_map_landmark =
      before.groups[0].modes[0].p_map_landmark + Eigen::Vector2d(0.5, 0.0);
  const std::vector<ControlPoint> points = {PointOn(before, 0, 0.0, 0.05, 0.1),
                                            PointOn(before, 1, 0.0, -0.05, 0.1)};
  MapContent content = before;
  EXPECT_EQ(HoldControlPoints(points, 0, &content).yaw(), 0.0);
}

// Of a covariance beyond what numbers hold, the frame is all that points tell.
TEST(ControlPointsTest, AShapeThatCannotBeComputedStays) {
  MapContent before = FourLandmarks(11);
  before.covariance = JointCovariance::FromDense(1e303 * before.covariance.Dense());
  for (int i = 0; i < 4; ++i) {
    before.groups[static_cast<std::size_t>(i)].modes[0].cov_p_map_landmark =
        before.covariance.Block(i, i);
  }
  MapContent content = before;
  std::vector<ControlPoint> points;
  for (const int i : {0, 1, 3}) points.push_back(PointOn(before, i, 3.0, -4.0, 1e-6));
  HoldControlPoints(points, 0, &content);
  EXPECT_THAT(content.covariance.Dense() / 1e299,
              IsNearMatrix(before.covariance.Dense() / 1e299, 1e-9));
  for (int i = 0; i < 4; ++i) {
    EXPECT_THAT(PositionsOf(content).segment<2>(2 * i) - PositionsOf(before).segment<2>(2 * i),
                IsNearMatrix(Eigen::Vector2d(3.0, -4.0), 1e-9));
  }
}

TEST(ControlPointsTest, PointsOfUnknownModesSayNothing) {
  const MapContent before = FourLandmarks(6);
  MapContent content = before;
  ControlPoint other = PointOn(before, 0, 1.0, 1.0, 0.1);
  other.mode = ModeNumber(7);
  HoldControlPoints({other}, 0, &content);
  EXPECT_EQ(GeometryHash(content), GeometryHash(before));
}

// Landmarks and points as a survey finds them: of a map whose errors have `ratio` times the
// variance that it states.
std::vector<ControlPoint> Survey(const MapContent& map,
                                 const Se2& T_new_old,
                                 double ratio,
                                 double sd_m,
                                 std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd root = map.covariance.Dense().llt().matrixL();
  Eigen::VectorXd error(root.cols());
  for (double& value : error) value = std::sqrt(ratio) * normal(random);
  const Eigen::VectorXd truth = PositionsOf(map) + root * error;
  std::vector<ControlPoint> points;
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector2d noise(sd_m * normal(random), sd_m * normal(random));
    points.push_back({map.groups[static_cast<std::size_t>(i)].signature,
                      ModeNumber(1),
                      T_new_old * Eigen::Vector2d(truth.segment<2>(2 * i)) + noise,
                      sd_m});
  }
  return points;
}

// NEES 3 of 2 degrees of freedom, and each point checked when it comes.
TEST(ControlPointsTest, AnHonestSurveyOfAnOverconfidentMapIsNotRefused) {
  std::mt19937_64 random(TestSeed(7));
  std::uniform_real_distribution<double> angle(-3.0, 3.0);
  int refused = 0;
  for (int survey = 0; survey < 300; ++survey) {
    MapContent content = FourLandmarks(100 + static_cast<std::uint64_t>(survey));
    const std::vector<ControlPoint> points =
        Survey(content, {300.0, -40.0, angle(random)}, 1.5, 0.02, random);
    std::vector<ControlPoint> held;
    for (const ControlPoint& point : points) {
      held.push_back(point);
      refused += CheckControlPoints(held, content).ok() ? 0 : 1;
      HoldControlPoints(held, held.size() - 1, &content);
    }
  }
  EXPECT_LE(refused, 2);
}

TEST(ControlPointsTest, APointThatContradictsTheOthersIsNamedWhicheverItIs) {
  std::mt19937_64 random(TestSeed(8));
  const MapContent content = FourLandmarks(8);
  for (std::size_t wrong = 0; wrong < 4; ++wrong) {
    for (const Eigen::Vector2d& by : {Eigen::Vector2d(30.0, 0.0), Eigen::Vector2d(0.0, -1.0)}) {
      std::vector<ControlPoint> points = Survey(content, {500.0, 500.0, 0.4}, 1.0, 0.01, random);
      ASSERT_THAT(CheckControlPoints(points, content), IsOk());
      points[wrong].p_map_landmark += by;
      const Status refused = CheckControlPoints(points, content);
      const std::string named = fmt::format("control point '{}': ", points[wrong].signature.text());
      ASSERT_THAT(refused, StatusIs(StatusCode::kInvalidArgument, named));
      EXPECT_NEAR(std::stod(Message(refused).substr(named.size())), by.norm(), 0.2);
    }
  }
}

TEST(ControlPointsTest, AMapIsHeldWithoutThePointThatAloneContradicts) {
  std::mt19937_64 random(TestSeed(8));
  const MapContent content = FourLandmarks(8);
  std::vector<ControlPoint> points = Survey(content, {500.0, 500.0, 0.4}, 1.0, 0.01, random);
  EXPECT_EQ(FittingControlPoints(points, content).size(), 4U);
  points[1].p_map_landmark.x() += 3.0;
  const std::vector<ControlPoint> fitting = FittingControlPoints(points, content);
  ASSERT_EQ(fitting.size(), 3U);
  EXPECT_EQ(fitting[1].signature, points[2].signature);
  // Which of two is wrong, nobody knows.
  EXPECT_TRUE(FittingControlPoints({points[0], points[1]}, content).empty());
}

// Of two points nobody knows which is wrong: the one that came last is the one to look at first.
TEST(ControlPointsTest, TwoPointsAtAnotherDistanceThanInTheMapAreRefused) {
  const MapContent content = FourLandmarks(9);
  EXPECT_THAT(CheckControlPoints({PointOn(content, 0, 0.0, 0.0, 0.02)}, content), IsOk());
  const Eigen::Vector2d apart = PositionsOf(content).segment<2>(4).normalized();
  ControlPoint second = PointOn(content, 2, 7.0 * apart.x(), 7.0 * apart.y(), 0.02);
  const Status refused = CheckControlPoints({PointOn(content, 0, 0.0, 0.0, 0.02), second}, content);
  EXPECT_THAT(refused, StatusIs(StatusCode::kInvalidArgument, "'L3'"));
}

// Of a frame that is turned by a right angle, points within half a metre do not tell: a map held on
// them would bend.
TEST(ControlPointsTest, PointsTooCloseTogetherForATurnedFrameAreRefused) {
  MapContent content = FourLandmarks(5);
  const Eigen::Vector2d p = content.groups[0].modes[0].p_map_landmark;
  content.groups[1].modes[0].p_map_landmark = p + Eigen::Vector2d(0.5, 0.0);
  ControlPoint second = PointOn(content, 1, 0.0, 0.0, 0.05);
  second.p_map_landmark = p + Eigen::Vector2d(0.0, 0.5);
  EXPECT_THAT(CheckControlPoints({PointOn(content, 0, 0.0, 0.0, 0.05), second}, content),
              StatusIs(StatusCode::kInvalidArgument, "farther apart"));
}

}  // namespace
}  // namespace shiftmap::testing

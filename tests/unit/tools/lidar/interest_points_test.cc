// SPDX-License-Identifier: Apache-2.0
#include "tools/lidar/interest_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

#include "tests/support/ray_caster.h"

namespace shiftmap {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180.0;
constexpr std::size_t kBeams = 1081;

using Points = std::vector<Eigen::Vector2d>;

// A quarter of a degree from beam to beam, 270 degrees.
LidarSensor WideSensor() { return {.field_of_view_rad = 1.5 * kPi}; }

Points Detect(const std::vector<Wall>& walls,
              const Se2& T_map_lidar,
              const InterestPointOptions& options = {}) {
  const LidarSensor sensor = WideSensor();
  Points points;
  for (const InterestPoint& point :
       DetectInterestPoints(CastScan(walls, T_map_lidar, kBeams, sensor), sensor, options)) {
    points.push_back(T_map_lidar * point.p_lidar);
  }
  return points;
}

double DistanceToNearest(const Eigen::Vector2d& p, const Points& points) {
  double nearest = 1e9;
  for (const Eigen::Vector2d& other : points) nearest = std::min(nearest, (other - p).norm());
  return nearest;
}

// Exactly these, each within `within_m`.
void ExpectPoints(const Points& expected, const Points& found, double within_m) {
  EXPECT_EQ(found.size(), expected.size());
  for (const Eigen::Vector2d& p : expected) {
    EXPECT_LT(DistanceToNearest(p, found), within_m) << p.transpose();
  }
}

const Points kRoom = {{0.0, 0.0}, {6.0, 0.0}, {6.0, 5.0}, {0.0, 5.0}};

TEST(InterestPoints, AreTheCornersOfARoom) {
  // The view of 270 degrees to either side of x leaves out what is behind: the corner at (0, 0).
  ExpectPoints({kRoom[1], kRoom[2], kRoom[3]},
               Detect(WallsAlong(kRoom, true), Se2(2.5, 2.2, 45.0 * kDegree)),
               0.04);
}

TEST(InterestPoints, AreFoundAtEveryScaleInsideOfOneAnotherOnce) {
  // A niche of 0.5 m x 0.5 m in a wall: four corners that the coarser scales see as one.
  const Points niche = {
      {4.0, -3.0}, {4.0, -0.25}, {4.5, -0.25}, {4.5, 0.25}, {4.0, 0.25}, {4.0, 3.0}};
  ExpectPoints({niche[1], niche[2], niche[3], niche[4]},
               Detect(WallsAlong(niche, false), Se2(1.0, 0.0, 0.0)),
               0.06);
}

// x at the corner of two long walls is 4/√(2π) sin(φ/2), and F_min = 0.367 asks for x >= 0.932.
TEST(InterestPoints, TurnByAsMuchAsTheSmallestResponseAsksFor) {
  const auto corners = [](double turn, const InterestPointOptions& options) {
    // Symmetric about the beam that hits it.
    const Eigen::Vector2d arm(-3.0 * std::sin(0.5 * turn), 3.0 * std::cos(0.5 * turn));
    const Eigen::Vector2d corner(3.5, 0.0);
    const Points line = {corner + Eigen::Vector2d(arm.x(), -arm.y()), corner, corner + arm};
    return Detect(WallsAlong(line, false), Se2(), options).size();
  };
  EXPECT_EQ(corners(0.0, {}), 0U);
  EXPECT_EQ(corners(68.0 * kDegree, {}), 0U);
  EXPECT_EQ(corners(75.0 * kDegree, {}), 1U);
  EXPECT_EQ(corners(90.0 * kDegree, {}), 1U);
  EXPECT_EQ(corners(120.0 * kDegree, {}), 1U);
  InterestPointOptions flat;
  const double x = 4.0 / std::sqrt(2.0 * kPi) * std::sin(15.0 * kDegree);
  flat.min_response = x * std::exp(-x);
  EXPECT_EQ(corners(27.0 * kDegree, flat), 0U);
  EXPECT_EQ(corners(33.0 * kDegree, flat), 1U);
}

TEST(InterestPoints, StayWhereTheyAreWhenTheVehicleTurnsOrMoves) {
  const std::vector<Wall> walls = WallsAlong(kRoom, true);
  const Se2 pose(2.5, 2.2, 45.0 * kDegree);
  const Points before = Detect(walls, pose);
  // By whole beams: the same hits.
  const Points turned = Detect(walls, pose * Se2(0.0, 0.0, 10.0 * 1.5 * kPi / (kBeams - 1)));
  ASSERT_EQ(turned.size(), before.size());
  for (const Eigen::Vector2d& p : turned) EXPECT_LT(DistanceToNearest(p, before), 1e-9);
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-0.3, 0.3);
  for (int i = 0; i < 50; ++i) {
    const Points moved =
        Detect(walls, pose * Se2(uniform(random), uniform(random), uniform(random)));
    for (const Eigen::Vector2d& p : moved) EXPECT_LT(DistanceToNearest(p, before), 0.06);
    EXPECT_GE(moved.size(), 3U);
  }
}

// The scan of a mirrored world is the scan in reverse.
TEST(InterestPoints, AreTheSameInAMirror) {
  const LidarSensor sensor = WideSensor();
  std::vector<double> ranges =
      CastScan(WallsAlong(kRoom, true), Se2(2.0, 2.0, 0.7), kBeams, sensor);
  const auto points = DetectInterestPoints(ranges, sensor, {});
  std::reverse(ranges.begin(), ranges.end());
  const auto mirrored = DetectInterestPoints(ranges, sensor, {});
  ASSERT_EQ(mirrored.size(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d& p = mirrored[points.size() - 1 - i].p_lidar;
    EXPECT_LT((p - Eigen::Vector2d(points[i].p_lidar.x(), -points[i].p_lidar.y())).norm(), 0.03);
  }
}

TEST(InterestPoints, AreEdgesOfWhatStandsBeforeAndNotItsShadow) {
  std::vector<Wall> walls = WallsAlong({{5.0, -6.0}, {5.0, 6.0}}, false);
  walls.push_back({{2.0, -0.4}, {2.0, 0.4}});
  ExpectPoints({{2.0, -0.4}, {2.0, 0.4}}, Detect(walls, Se2()), 0.02);
  InterestPointOptions corners_only;
  corners_only.edges = false;
  ExpectPoints({}, Detect(walls, Se2(), corners_only), 0.0);
}

TEST(InterestPoints, AreNotWhereAGrazedWallIsHitTooRarely) {
  const std::vector<Wall> walls = {{{-2.0, 1.0}, {79.0, 1.0}}};
  ExpectPoints({}, Detect(walls, Se2()), 0.0);
}

TEST(InterestPoints, AreFoundInNoise) {
  const std::vector<Wall> walls = WallsAlong(kRoom, true);
  const LidarSensor sensor = WideSensor();
  const Se2 pose(2.5, 2.2, 45.0 * kDegree);
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0.0, 0.01);
  std::size_t found = 0;
  for (int i = 0; i < 20; ++i) {
    std::vector<double> ranges = CastScan(walls, pose, kBeams, sensor);
    for (double& range : ranges) range += noise(random);
    Points points;
    for (const InterestPoint& point : DetectInterestPoints(ranges, sensor, {})) {
      points.push_back(pose * point.p_lidar);
    }
    found += points.size();
    for (const Eigen::Vector2d& corner : {kRoom[1], kRoom[2], kRoom[3]}) {
      EXPECT_LT(DistanceToNearest(corner, points), 0.1);
    }
  }
  EXPECT_EQ(found, 60U);
}

TEST(InterestPoints, NeedReturns) {
  const LidarSensor sensor;
  EXPECT_TRUE(DetectInterestPoints({}, sensor, {}).empty());
  EXPECT_TRUE(DetectInterestPoints(std::vector<double>{1.0}, sensor, {}).empty());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double range : {0.0, -1.0, 80.0, 1e300, nan}) {
    EXPECT_TRUE(DetectInterestPoints(std::vector<double>(181, range), sensor, {}).empty());
  }
}

TEST(InterestPointOptions, NamesWhatIsOutOfRange) {
  EXPECT_TRUE(InterestPointOptions().Validate().ok());
  EXPECT_TRUE(LidarSensor().Validate().ok());
  const auto message = [](const InterestPointOptions& options) {
    return Message(options.Validate());
  };
  EXPECT_NE(message({.min_response = 0.368}).find("min_response 0.368"), std::string::npos);
  EXPECT_NE(message({.max_gap_m = 0.0}).find("max_gap_m 0"), std::string::npos);
  EXPECT_NE(message({.scale_step = 1.0}).find("scale_step 1"), std::string::npos);
  EXPECT_FALSE(LidarSensor{.field_of_view_rad = 7.0}.Validate().ok());
  EXPECT_FALSE(LidarSensor{.max_range_m = 0.0}.Validate().ok());
}

}  // namespace
}  // namespace shiftmap

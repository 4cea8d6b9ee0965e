// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/scan_polygon.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace shiftmap {
namespace {

constexpr double kPi = std::numbers::pi;

using Border = std::vector<Eigen::Vector2d>;

double Phi(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

// A square room of 2·half x 2·half around the lidar, all round.
Border Square(double half) {
  Border border;
  for (int i = 0; i < 720; ++i) {
    const double bearing = -kPi + (i + 0.5) * kPi / 360.0;
    const double range = half / std::max(std::abs(std::cos(bearing)), std::abs(std::sin(bearing)));
    border.emplace_back(range * std::cos(bearing), range * std::sin(bearing));
  }
  return border;
}

// Ranges of 10 m from -view/2 to view/2.
Border Sector(double view) {
  Border border;
  for (int i = 0; i <= 180; ++i) {
    const double bearing = view * (i / 180.0 - 0.5);
    border.emplace_back(10.0 * std::cos(bearing), 10.0 * std::sin(bearing));
  }
  return border;
}

// Even-odd rule over the closed polygon.
bool EvenOdd(const Border& polygon, const Eigen::Vector2d& p) {
  bool inside = false;
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const Eigen::Vector2d& a = polygon[i];
    const Eigen::Vector2d& b = polygon[j];
    if ((a.y() > p.y()) != (b.y() > p.y()) &&
        p.x() < a.x() + (p.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x())) {
      inside = !inside;
    }
  }
  return inside;
}

PoseWithCovariance PoseAt(const Se2& T_map_vehicle, double sd_m, double sd_rad) {
  return {T_map_vehicle, Eigen::Vector3d(sd_m, sd_m, sd_rad).cwiseAbs2().asDiagonal()};
}

TEST(ScanPolygon, ContainsWhatThePointInPolygonRuleSays) {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const Se2 T_vehicle_lidar(0.7, -0.3, 2.0);
  for (const bool all_round : {false, true}) {
    for (int scan = 0; scan < 40; ++scan) {
      const double view = all_round ? 2.0 * kPi * 59.0 / 60.0 : 1.0 + 4.5 * uniform(random);
      Border border;
      for (int i = 0; i < 60; ++i) {
        const double bearing = view * (i / 59.0 - 0.5);
        const double range = 1.0 + 5.0 * uniform(random);
        border.emplace_back(range * std::cos(bearing), range * std::sin(bearing));
      }
      const ScanPolygon polygon(border, T_vehicle_lidar, all_round, 0.0);
      Border closed = border;
      if (!all_round) closed.emplace_back(0.0, 0.0);
      for (int i = 0; i < 500; ++i) {
        const Eigen::Vector2d q(12.0 * uniform(random) - 6.0, 12.0 * uniform(random) - 6.0);
        ASSERT_EQ(polygon.Contains(T_vehicle_lidar * q), EvenOdd(closed, q)) << q.transpose();
      }
    }
  }
}

TEST(ScanPolygon, GrowsAwayFromTheLidar) {
  const ScanPolygon polygon(Sector(kPi), Se2(1.0, 0.0, 0.0), false, 0.5);
  EXPECT_TRUE(polygon.Contains({11.49, 0.0}));
  EXPECT_FALSE(polygon.Contains({11.51, 0.0}));
  EXPECT_TRUE(polygon.Contains({1.01, 10.49}));
  EXPECT_FALSE(polygon.Contains({0.99, 10.0}));  // Behind it: not to the sides.
}

TEST(ScanPolygon, NeedsTwoBeams) {
  EXPECT_FALSE(ScanPolygon({}, Se2(), false, 0.5).Contains({0.0, 0.0}));
  EXPECT_FALSE(ScanPolygon(Border{{1.0, 0.0}}, Se2(), true, 0.5).Contains({0.5, 0.0}));
}

// Far from other walls P is that of one normal variable on one side of a line.
TEST(ScanPolygonFieldOfView, IsThatOfAHalfPlaneAtAWall) {
  const ScanPolygonFieldOfView many({.samples = 20000});
  const ScanPolygonFieldOfView hundred;
  const ScanPolygon polygon(Square(20.0), Se2(), true, 0.0);
  const Se2 T_map_vehicle(3.0, -2.0, 0.8);
  const PoseWithCovariance pose = PoseAt(T_map_vehicle, 0.3, 0.0);
  const Eigen::Matrix2d R = T_map_vehicle.Rotation();
  const Eigen::Matrix2d cov = R * Eigen::Vector2d(0.16, 4.0).asDiagonal() * R.transpose();
  for (const double beyond : {-2.0, -1.0, -0.3, 0.0, 0.5, 1.0}) {
    const double expected = Phi(-beyond / 0.5);
    const Eigen::Vector2d p = T_map_vehicle * Eigen::Vector2d(20.0 + beyond, 1.0);
    EXPECT_NEAR(many(polygon, pose, p, cov), expected, 0.012) << beyond;
    EXPECT_NEAR(hundred(polygon, pose, p, cov), expected, 0.15) << beyond;
  }
}

TEST(ScanPolygonFieldOfView, IsThatOfTheHeadingAtTheEndOfTheSector) {
  const ScanPolygonFieldOfView many({.samples = 20000});
  const ScanPolygon polygon(Sector(0.5 * kPi), Se2(), false, 0.5);
  const PoseWithCovariance pose = PoseAt(Se2(), 0.0, 0.1);
  for (const double off : {-0.2, -0.05, 0.0, 0.1}) {
    const double bearing = 0.25 * kPi + off;
    const Eigen::Vector2d p(5.0 * std::cos(bearing), 5.0 * std::sin(bearing));
    EXPECT_NEAR(many(polygon, pose, p, Eigen::Matrix2d::Zero()), Phi(-off / 0.1), 0.012) << off;
  }
}

TEST(ScanPolygonFieldOfView, IsCertainWithoutUncertainty) {
  const ScanPolygonFieldOfView view;
  const ScanPolygon polygon(Sector(kPi), Se2(), false, 0.5);
  const PoseWithCovariance pose = PoseAt(Se2(1.0, 1.0, 0.5 * kPi), 0.0, 0.0);
  const Eigen::Matrix2d zero = Eigen::Matrix2d::Zero();
  EXPECT_EQ(view(polygon, pose, {1.0, 11.4}, zero), 1.0);
  EXPECT_EQ(view(polygon, pose, {1.0, 11.6}, zero), 0.0);
  EXPECT_EQ(view(polygon, pose, {1.0, 0.5}, zero), 0.0);
}

// Moving map and vehicle together moves nothing that the scan says.
TEST(ScanPolygonFieldOfView, DoesNotDependOnTheMapsFrame) {
  const ScanPolygonFieldOfView view;
  const ScanPolygon polygon(Square(4.0), Se2(0.2, 0.1, 0.3), true, 0.5);
  const Eigen::Matrix2d cov = 0.04 * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d p(4.3, 0.4);
  const double before = view(polygon, PoseAt(Se2(), 0.2, 0.05), p, cov);
  EXPECT_GT(before, 0.2);
  EXPECT_LT(before, 0.98);
  const Se2 moved(100.0, -50.0, 0.5 * kPi);
  EXPECT_NEAR(view(polygon, PoseAt(moved, 0.2, 0.05), moved * p, cov), before, 0.1);
}

TEST(ScanPolygonFieldOfView, IsZeroForWhatIsNoNumber) {
  const ScanPolygonFieldOfView view;
  const ScanPolygon polygon(Square(4.0), Se2(), true, 0.5);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(view(polygon, PoseAt(Se2(), 0.1, 0.1), {nan, 0.0}, Eigen::Matrix2d::Identity()), 0.0);
  EXPECT_EQ(view(polygon, PoseAt(Se2(), nan, 0.1), {1.0, 0.0}, Eigen::Matrix2d::Identity()), 0.0);
}

}  // namespace
}  // namespace shiftmap

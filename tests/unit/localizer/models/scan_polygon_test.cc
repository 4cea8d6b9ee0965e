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

// The border as the ranges of a scan: the same area.
TEST(ScanPolygon, IsThatOfAScansRanges) {
  LidarScan scan;
  scan.sensor = {.field_of_view_rad = 4.0, .max_range_m = 9.0, .T_vehicle_lidar = {0.7, -0.3, 2.0}};
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  ScanPolygon reused;
  for (const bool all_round : {false, true}) {
    const std::size_t beams = all_round ? 90 : 60;
    if (all_round) scan.sensor.field_of_view_rad = 2.0 * kPi * 89.0 / 90.0;
    scan.ranges_m.clear();
    Border border;
    for (std::size_t i = 0; i < beams; ++i) {
      const auto range = static_cast<float>(10.0 * uniform(random));
      scan.ranges_m.push_back(i % 7 == 0 ? 0.0f : range);
      // No return, also beyond the largest range: nothing up to there.
      const double reached = i % 7 == 0 || range >= 9.0f ? 9.0 : static_cast<double>(range);
      const double bearing = scan.sensor.Bearing(i, beams);
      border.emplace_back(reached * std::cos(bearing), reached * std::sin(bearing));
    }
    reused.Assign(scan, 0.5);
    const ScanPolygon polygon(border, scan.sensor.T_vehicle_lidar, all_round, 0.5);
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector2d p(24.0 * uniform(random) - 12.0, 24.0 * uniform(random) - 12.0);
      ASSERT_EQ(reused.Contains(p), polygon.Contains(p)) << p.transpose();
    }
  }
}

TEST(ScanPolygon, StaysWhereItIsWhenTheVehicleDrivesOn) {
  ScanPolygon polygon(Square(4.0), Se2(0.2, 0.1, 0.3), true, 0.5);
  const ScanPolygon before = polygon;
  const Se2 T_begin_end(0.7, -0.2, 0.4);
  polygon.SetVehicle(T_begin_end);
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-6.0, 6.0);
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector2d p(uniform(random), uniform(random));
    ASSERT_EQ(polygon.Contains(p), before.Contains(T_begin_end * p)) << p.transpose();
  }
}

// What is said of a disc holds for its points, and is said of most.
TEST(ScanPolygon, KnowsOfADiscWhatHoldsForAllItsPoints) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  int said = 0;
  constexpr int kDiscs = 4000;
  for (int disc = 0; disc < kDiscs; ++disc) {
    const bool all_round = disc % 2 == 0;
    const double view = all_round ? 2.0 * kPi * 59.0 / 60.0 : 0.5 + 5.5 * uniform(random);
    Border border;
    for (int i = 0; i < 60; ++i) {
      const double bearing = view * (i / 59.0 - 0.5);
      const double range = 2.0 + 4.0 * uniform(random);
      border.emplace_back(range * std::cos(bearing), range * std::sin(bearing));
    }
    const ScanPolygon polygon(border, Se2(0.7, -0.3, 2.0), all_round, 0.0);
    const Eigen::Vector2d p(16.0 * uniform(random) - 8.0, 16.0 * uniform(random) - 8.0);
    const double radius = uniform(random);
    const auto contains = polygon.ContainsDisc(p, radius);
    if (!contains) continue;
    ++said;
    for (int i = 0; i < 100; ++i) {
      const double angle = 2.0 * kPi * uniform(random);
      const double r = radius * std::sqrt(uniform(random));
      const Eigen::Vector2d q = p + r * Eigen::Vector2d(std::cos(angle), std::sin(angle));
      ASSERT_EQ(polygon.Contains(q), *contains) << q.transpose() << ", " << radius;
    }
  }
  EXPECT_GT(said, kDiscs / 2);
}

// Far from other walls P is that of one normal variable on one side of a line.
TEST(ScanPolygonShare, IsThatOfAHalfPlaneAtAWall) {
  const ScanPolygonShare many({.samples = 20000});
  const ScanPolygonShare hundred;
  const ScanPolygon polygon(Square(20.0), Se2(), true, 0.0);
  const Eigen::Matrix2d cov = Eigen::Vector2d(0.25, 4.0).asDiagonal();
  for (const double beyond : {-2.0, -1.0, -0.3, 0.0, 0.5, 1.0}) {
    const double expected = Phi(-beyond / 0.5);
    const Eigen::Vector2d q(20.0 + beyond, 1.0);
    EXPECT_NEAR(many(polygon, q, cov), expected, 0.012) << beyond;
    EXPECT_NEAR(hundred(polygon, q, cov), expected, 0.15) << beyond;
  }
}

// A heading moves a landmark across the beam.
TEST(ScanPolygonShare, IsThatOfTheHeadingAtTheEndOfTheSector) {
  const ScanPolygonShare many({.samples = 20000});
  const ScanPolygon polygon(Sector(0.5 * kPi), Se2(), false, 0.5);
  for (const double off : {-0.2, -0.05, 0.0, 0.1}) {
    const double bearing = 0.25 * kPi + off;
    const Eigen::Vector2d q(5.0 * std::cos(bearing), 5.0 * std::sin(bearing));
    const Eigen::Vector2d across(-q.y(), q.x());
    const Eigen::Matrix2d cov = 0.01 * across * across.transpose();
    // Of a chord in the place of the arc: tan(off) rather than off.
    EXPECT_NEAR(many(polygon, q, cov), Phi(-std::tan(off) / 0.1), 0.012) << off;
  }
}

TEST(ScanPolygonShare, IsCertainWithoutUncertainty) {
  const ScanPolygonShare share;
  const ScanPolygon polygon(Sector(kPi), Se2(), false, 0.5);
  const Eigen::Matrix2d zero = Eigen::Matrix2d::Zero();
  EXPECT_EQ(share(polygon, {10.4, 0.0}, zero), 1.0);
  EXPECT_EQ(share(polygon, {10.6, 0.0}, zero), 0.0);
  EXPECT_EQ(share(polygon, {-0.5, 0.0}, zero), 0.0);
}

TEST(ScanPolygonShare, IsZeroForWhatIsNoNumber) {
  const ScanPolygonShare share;
  const ScanPolygon polygon(Square(4.0), Se2(), true, 0.5);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(share(polygon, {nan, 0.0}, Eigen::Matrix2d::Identity()), 0.0);
  EXPECT_EQ(share(polygon, {1.0, 0.0}, nan * Eigen::Matrix2d::Identity()), 0.0);
}

}  // namespace
}  // namespace shiftmap

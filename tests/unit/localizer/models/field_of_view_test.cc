// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/field_of_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "localizer/models/detection_model.h"
#include "tests/support/ray_caster.h"

namespace shiftmap {
namespace {

constexpr double kPi = std::numbers::pi;

constexpr double kMaxAge = 0.5;  // [s]

Stamp At(double seconds) { return StampFromSeconds(1000.0 + seconds); }

SensorCalibration Sensor() {
  SensorCalibration sensor;
  sensor.max_range_m = 8.0;
  sensor.max_bearing_rad = 1.2;
  return sensor;
}

// Of a vehicle that sees as far and as wide as the sensor.
FieldOfView WholeView() { return FieldOfView(Sensor(), false); }

// A room of 20 m by 20 m with a screen before the vehicle, 3 m ahead of the origin.
std::vector<Wall> Room() {
  std::vector<Wall> walls =
      WallsAlong({{-10.0, -10.0}, {10.0, -10.0}, {10.0, 10.0}, {-10.0, 10.0}}, true);
  walls.push_back({{3.0, -1.0}, {3.0, 1.0}});
  return walls;
}

LidarScan ScanAt(const Se2& T_map_vehicle, Stamp stamp) {
  constexpr std::size_t kBeams = 361;
  LidarScan scan;
  scan.stamp = stamp;
  scan.sensor.T_vehicle_lidar = Se2(0.4, 0.1, 0.2);
  scan.sensor.field_of_view_rad = 1.5 * kPi;
  for (const double range :
       CastScan(Room(), T_map_vehicle * scan.sensor.T_vehicle_lidar, kBeams, scan.sensor)) {
    scan.ranges_m.push_back(static_cast<float>(range));
  }
  return scan;
}

// Gives both views the same points and compares.
void ExpectSame(const FieldOfView& a, const FieldOfView& b, double tolerance) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> uniform(-9.0, 9.0);
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector2d q(uniform(random), uniform(random));
    const Eigen::Matrix2d cov = 1e-3 * std::abs(uniform(random)) * Eigen::Matrix2d::Identity();
    ASSERT_NEAR(a.Probability(q, cov).sensor, b.Probability(q, cov).sensor, tolerance)
        << q.transpose();
    ASSERT_EQ(a.Probability(q, cov).own, a.Probability(q, cov).sensor);
    if (tolerance == 0.0) {
      ASSERT_EQ(a.WellInView(q), b.WellInView(q)) << q.transpose();
    }
  }
}

LidarView ViewOf(const LidarScan& scan, Stamp now) {
  LidarView lidar;
  lidar.Take(scan);
  lidar.Move(Se2(), 0.0, now, kMaxAge);
  return lidar;
}

TEST(FieldOfView, WithoutAScanOfTheTimeIsTheSector) {
  const FieldOfView sector = WholeView();
  FieldOfView polygon = WholeView();
  LidarView lidar;
  lidar.Move(Se2(), 0.1, At(0.0), kMaxAge);
  polygon.Look(&lidar);
  ExpectSame(polygon, sector, 0.0);
  const LidarScan scan = ScanAt(Se2(), At(0.0));
  // Before the scan, and when it is old.
  for (const double seconds : {-0.01, 0.51, 1e6}) {
    lidar = ViewOf(scan, At(seconds));
    EXPECT_FALSE(lidar.counts);
    polygon.Look(&lidar);
    ExpectSame(polygon, sector, 0.0);
  }
  lidar = ViewOf(scan, At(0.5));
  EXPECT_TRUE(lidar.counts);
  polygon.Look(&lidar);
  EXPECT_EQ(polygon.Probability({5.0, 0.0}, 1e-4 * Eigen::Matrix2d::Identity()).sensor, 0.0);
  polygon.Look(nullptr);
  ExpectSame(polygon, sector, 0.0);
}

TEST(FieldOfView, SectorIsThatOfTheDetectionModel) {
  const FieldOfView view(Sensor());
  const Eigen::Vector2d q(6.0, 4.0);
  const double variance = 0.04;
  // An isotropic place is as uncertain along as across.
  const Eigen::Vector2d of_z(variance, variance / q.squaredNorm());
  EXPECT_NEAR(view.Probability(q, variance * Eigen::Matrix2d::Identity()).sensor,
              SectorFieldOfView(
                  {q.norm(), std::atan2(q.y(), q.x())}, of_z.asDiagonal(), SectorOf(Sensor())),
              1e-12);
}

// What others see says nothing of what this vehicle should.
TEST(FieldOfView, OfAVehicleIsWhereItHasSeenLandmarks) {
  FieldOfView view(Sensor());
  const Eigen::Matrix2d cov = 1e-4 * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d near(3.0, 0.0);
  const Eigen::Vector2d far(6.0, 0.0);
  const Eigen::Vector2d aside(1.0, 2.0);
  for (const Eigen::Vector2d& q : {near, far, aside}) {
    EXPECT_EQ(view.Probability(q, cov).own, 0.0);
    EXPECT_FALSE(view.WellInView(q));
  }
  view.Saw({4.0, 0.5});
  view.Saw({4.0, -0.5});
  EXPECT_NEAR(view.Probability(near, cov).own, 1.0, 1e-9);
  EXPECT_TRUE(view.WellInView(near));
  for (const Eigen::Vector2d& q : {far, aside}) {
    EXPECT_NEAR(view.Probability(q, cov).sensor, 1.0, 1e-9);
    EXPECT_NEAR(view.Probability(q, cov).own, 0.0, 1e-9);
    EXPECT_FALSE(view.WellInView(q));
  }
}

TEST(FieldOfView, IsTheSectorWhereNothingStandsBeforeIt) {
  const FieldOfView sector = WholeView();
  FieldOfView polygon = WholeView();
  const LidarView lidar = ViewOf(ScanAt(Se2(), At(0.0)), At(0.0));
  polygon.Look(&lidar);
  const Eigen::Matrix2d cov = 0.0025 * Eigen::Matrix2d::Identity();
  const auto both = [&](const Eigen::Vector2d& q) {
    return std::pair(polygon.Probability(q, cov).sensor, sector.Probability(q, cov).sensor);
  };
  for (const Eigen::Vector2d& q : {Eigen::Vector2d(5.0, 4.0),
                                   Eigen::Vector2d(2.0, 0.0),
                                   Eigen::Vector2d(3.0, 0.0),  // On the screen.
                                   Eigen::Vector2d(9.0, 0.0),
                                   Eigen::Vector2d(-4.0, 0.0)}) {
    EXPECT_NEAR(both(q).first, both(q).second, 1e-12) << q.transpose();
    EXPECT_EQ(polygon.WellInView(q), sector.WellInView(q)) << q.transpose();
  }
  const Eigen::Vector2d behind(5.0, 0.0);
  EXPECT_EQ(both(behind).first, 0.0);
  EXPECT_NEAR(both(behind).second, 1.0, 1e-9);
  EXPECT_FALSE(polygon.WellInView(behind));
  EXPECT_TRUE(sector.WellInView(behind));
  // In the wall, as the area is grown by half a metre: half a landmark is in view, none surely.
  EXPECT_NEAR(both({3.5, 0.0}).first, 0.5, 0.2);
  EXPECT_FALSE(polygon.WellInView({3.5, 0.0}));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(polygon.Probability({nan, 0.0}, cov).sensor, 0.0);
  EXPECT_EQ(polygon.Probability({nan, 0.0}, cov).own, 0.0);
}

// A scan that was made on the way is as good as one made at its end.
TEST(FieldOfView, ALidarScanKeepsItsPlaceWhileTheVehicleDrives) {
  const Eigen::Vector3d twist_per_s(2.0, 0.0, 0.8);
  const auto pose = [&](double seconds) { return Se2::Exp(seconds * twist_per_s); };
  FieldOfView moved(Sensor());
  LidarView lidar;
  lidar.Take(ScanAt(pose(0.1), At(0.1)));
  lidar.Move(pose(0.2), 0.2, At(0.2), kMaxAge);  // It was made half-way.
  lidar.Move(pose(0.25), 0.25, At(0.45), kMaxAge);
  moved.Look(&lidar);
  ASSERT_TRUE(lidar.counts);
  const FieldOfView sector(Sensor());
  FieldOfView now(Sensor());
  const LidarView at_end = ViewOf(ScanAt(pose(0.45), At(0.45)), At(0.45));
  now.Look(&at_end);
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> uniform(-9.0, 9.0);
  const Eigen::Matrix2d cov = 0.0025 * Eigen::Matrix2d::Identity();
  int apart = 0;
  int occluded = 0;
  constexpr int kPoints = 2000;
  for (int i = 0; i < kPoints; ++i) {
    const Eigen::Vector2d q(uniform(random), uniform(random));
    apart += std::abs(moved.Probability(q, cov).sensor - now.Probability(q, cov).sensor) > 0.3;
    occluded += sector.Probability(q, cov).sensor - now.Probability(q, cov).sensor > 0.5;
  }
  // The shadow of the screen as seen from there and from here.
  EXPECT_LT(apart, occluded / 4);
  EXPECT_GT(occluded, 30);
}

TEST(FieldOfView, HasItsModelsByName) {
  for (std::size_t i = 0; i < FieldOfViewNames().size(); ++i) {
    EXPECT_EQ(FieldOfViewNamed(FieldOfViewNames()[i]), static_cast<FieldOfViewModel>(i));
  }
}

}  // namespace
}  // namespace shiftmap

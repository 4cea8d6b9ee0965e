// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/ray_caster.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/support/ray_caster.h"
#include "tools/sim/random.h"

namespace shiftmap {
namespace {

constexpr double kFarM = 100.0;

Eigen::Vector2d RandomPoint(double low, double high, Random* random) {
  const double x = Uniform(low, high, random);
  return {x, Uniform(low, high, random)};
}

// Walls of every length and direction, some along the axes and on the lines of the grid.
std::vector<Wall> RandomWalls(int count, Random* random) {
  std::vector<Wall> walls;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d a = RandomPoint(-15.0, 15.0, random);
    const double length = std::exp(Uniform(-3.0, 3.0, random));
    Eigen::Vector2d b = a + length * RandomPoint(-1.0, 1.0, random);
    if (i % 5 == 1) b.x() = a.x();
    if (i % 5 == 2) b.y() = a.y();
    walls.push_back({a, b});
    if (i % 7 == 3) walls.push_back({a.array().round(), b.array().round()});
  }
  return walls;
}

void ExpectAsByBruteForce(const std::vector<Wall>& walls, double cell_m, Random* random) {
  constexpr std::size_t kBeams = 181;
  const RayCaster caster(walls, cell_m);
  LidarSensor sensor;
  sensor.field_of_view_rad = 6.2;
  for (int i = 0; i < 20; ++i) {
    Eigen::Vector2d p = RandomPoint(-20.0, 20.0, random);
    if (i % 4 == 0) p = p.array().round();
    const Se2 T_map_lidar(p, i % 3 == 0 ? 0.0 : Uniform(-3.0, 3.0, random));
    const std::vector<double> expected = CastScan(walls, T_map_lidar, kBeams, sensor);
    for (std::size_t beam = 0; beam < kBeams; ++beam) {
      const double yaw = T_map_lidar.yaw() + sensor.Bearing(beam, kBeams);
      const RayHit hit = caster.Cast(p, {std::cos(yaw), std::sin(yaw)}, kFarM);
      ASSERT_NEAR(std::min(hit.range_m, kFarM), expected[beam], 1e-7)
          << "cell " << cell_m << ", from " << p.transpose() << ", yaw " << yaw;
    }
  }
}

TEST(RayCaster, HitsWhatBruteForceHits) {
  Random random = MakeRandom(3, 0);
  for (const int count : {1, 7, 200}) {
    for (const double cell_m : {0.3, 1.0, 50.0}) {
      for (int i = 0; i < 4; ++i)
        ExpectAsByBruteForce(RandomWalls(count, &random), cell_m, &random);
    }
  }
}

TEST(RayCaster, LooksNoFurtherThanTold) {
  const std::vector<Wall> walls = {{{5.0, -1.0}, {5.0, 1.0}}};
  const RayCaster caster(walls);
  EXPECT_NEAR(caster.Cast({0.0, 0.0}, {1.0, 0.0}, 5.1).range_m, 5.0, 1e-12);
  EXPECT_FALSE(caster.Cast({0.0, 0.0}, {1.0, 0.0}, 4.9).hit());
  EXPECT_FALSE(caster.Cast({0.0, 0.0}, {-1.0, 0.0}, kFarM).hit());
  EXPECT_FALSE(RayCaster({}).Cast({0.0, 0.0}, {1.0, 0.0}, kFarM).hit());
}

TEST(RayCaster, TellsTheAngleOfIncidence) {
  const std::vector<Wall> walls = {{{3.0, -10.0}, {3.0, 10.0}}};
  const RayCaster caster(walls);
  for (const double angle : {0.0, 0.4, -1.1}) {
    const RayHit hit = caster.Cast({0.0, 0.0}, {std::cos(angle), std::sin(angle)}, kFarM);
    EXPECT_NEAR(hit.cos_incidence, std::cos(angle), 1e-12);
  }
}

TEST(RayCaster, SeesUpToTheWall) {
  const std::vector<Wall> walls = {{{5.0, -1.0}, {5.0, 1.0}}};
  const RayCaster caster(walls);
  EXPECT_TRUE(caster.InSight({0.0, 0.0}, {4.9, 0.0}));
  EXPECT_TRUE(caster.InSight({0.0, 0.0}, {5.0, 0.0}));
  EXPECT_FALSE(caster.InSight({0.0, 0.0}, {5.1, 0.0}));
  EXPECT_FALSE(caster.InSight({5.1, 0.0}, {0.0, 0.0}));
  EXPECT_TRUE(caster.InSight({0.0, 2.0}, {8.0, 2.0}));
  EXPECT_TRUE(caster.InSight({5.0, 0.0}, {5.0, 0.0}));
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/tunnels.h"

#include <gtest/gtest.h>

#include <cmath>

namespace shiftmap {
namespace {

Outline Box(double x, double y, double width, double height) {
  return {{x, y}, {x + width, y}, {x + width, y + height}, {x, y + height}};
}

double LengthOfWalls(const std::vector<Wall>& walls) {
  double length = 0.0;
  for (const Wall& wall : walls) length += (wall.b - wall.a).norm();
  return length;
}

TEST(Tunnels, TheUnionOfACrossHasItsOutlineOnly) {
  const std::vector<Outline> cross = {Box(-5.0, -1.0, 10.0, 2.0), Box(-1.0, -5.0, 2.0, 10.0)};
  const std::vector<Wall> walls = WallsOfUnion(cross);
  EXPECT_NEAR(LengthOfWalls(walls), 4.0 * (2.0 + 4.0 + 4.0), 1e-9);
  for (const Wall& wall : walls) {
    const Eigen::Vector2d middle = 0.5 * (wall.a + wall.b);
    EXPECT_GE(middle.cwiseAbs().maxCoeff(), 1.0 - 1e-9);
  }
}

// Each wall has open space on one side and rock on the other, by all outlines.
TEST(Tunnels, WallsPartOpenSpaceFromRock) {
  Random random = MakeRandom(2, 0);
  std::vector<Outline> outlines;
  for (int i = 0; i < 12; ++i) {
    const Eigen::Vector2d from(Uniform(0.0, 40.0, &random), Uniform(0.0, 40.0, &random));
    const Eigen::Vector2d to(Uniform(0.0, 40.0, &random), Uniform(0.0, 40.0, &random));
    const std::vector<Eigen::Vector2d> centre = {from, to};
    outlines.push_back(DigTunnel(centre, 5.0, {0.3, 2.0}, &random).ToOutline());
  }
  const auto open = [&](const Eigen::Vector2d& p) {
    bool any = false;
    for (const Outline& outline : outlines) any = any || IsInside(outline, p);
    return any;
  };
  int checked = 0;
  for (const Wall& wall : WallsOfUnion(outlines)) {
    const Eigen::Vector2d along = wall.b - wall.a;
    if (along.norm() < 1e-3) continue;
    const Eigen::Vector2d across = 1e-6 * Eigen::Vector2d(-along.y(), along.x()).normalized();
    const Eigen::Vector2d middle = 0.5 * (wall.a + wall.b);
    EXPECT_NE(open(middle + across), open(middle - across));
    ++checked;
  }
  EXPECT_GT(checked, 100);
}

TEST(Tunnels, RoughWallsKeepTheirWidthOnAverage) {
  Random random = MakeRandom(4, 0);
  const std::vector<Eigen::Vector2d> centre = {{0.0, 0.0}, {2000.0, 0.0}};
  const TunnelSides sides = DigTunnel(centre, 6.0, {0.2, 1.0}, &random);
  double sum = 0.0;
  double sum2 = 0.0;
  for (const Eigen::Vector2d& p : sides.left) {
    sum += p.y();
    sum2 += (p.y() - 3.0) * (p.y() - 3.0);
    EXPECT_LE(std::abs(p.y() - 3.0), 0.4 + 1e-12);
  }
  const auto count = static_cast<double>(sides.left.size());
  EXPECT_NEAR(sum / count, 3.0, 0.02);
  // Of a Gaussian whose tails beyond two standard deviations are put there: 0.96 of it.
  EXPECT_NEAR(std::sqrt(sum2 / count), 0.192, 0.01);
}

TEST(Tunnels, PointsAlongALine) {
  const std::vector<Eigen::Vector2d> line = {{0.0, 0.0}, {3.0, 0.0}, {3.0, 4.0}};
  EXPECT_DOUBLE_EQ(LengthOf(line), 7.0);
  EXPECT_EQ(PointAlong(line, -1.0), Eigen::Vector2d(0.0, 0.0));
  EXPECT_EQ(PointAlong(line, 5.0), Eigen::Vector2d(3.0, 2.0));
  EXPECT_EQ(PointAlong(line, 9.0), Eigen::Vector2d(3.0, 4.0));
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/path_driver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tools/sim/tunnels.h"

namespace shiftmap {
namespace {

using Path = std::vector<Eigen::Vector2d>;

double DistanceTo(const Path& path, const Eigen::Vector2d& p) {
  double least = 1e9;
  for (double at = 0.0; at <= LengthOf(path); at += 0.05) {
    least = std::min(least, (PointAlong(path, at) - p).norm());
  }
  return least;
}

// Without noise, to the end.
std::vector<Se2> DriveAlong(const Path& path, const PathDriverOptions& options) {
  constexpr double kTickS = 0.05;
  const LoaderOptions loader_options;
  Loader loader(loader_options);
  PathDriver driver(path, options, loader_options);
  std::vector<Se2> poses = {driver.Start()};
  while (const auto command = driver.Drive(poses.back(), loader.v_mps())) {
    const Velocity velocity = loader.Step(*command, kTickS);
    poses.push_back(poses.back() *
                    Se2::Exp({velocity.v_mps * kTickS, 0.0, velocity.omega_radps * kTickS}));
    if (poses.size() > 20000) break;
  }
  return poses;
}

const Path& Bends() {
  static const Path path = {
      {0.0, 0.0}, {0.5, 15.0}, {-1.0, 28.0}, {1.0, 40.0}, {12.0, 50.0}, {30.0, 52.0}};
  return path;
}

TEST(PathDriver, StaysOnItsPathForwardsAndBackwards) {
  const std::vector<Se2> poses = DriveAlong(Bends(), {.legs = 4});
  ASSERT_LT(poses.size(), 20000U);
  for (const Se2& pose : poses) ASSERT_LT(DistanceTo(Bends(), pose.translation()), 1.2);
  EXPECT_LT((poses.back().translation() - Bends().front()).norm(), 0.6);
}

TEST(PathDriver, EndsWhereALegEnds) {
  const std::vector<Se2> there = DriveAlong(Bends(), {.legs = 1});
  EXPECT_LT((there.back().translation() - Bends().back()).norm(), 0.6);
  const std::vector<Se2> back = DriveAlong(Bends(), {.legs = 2});
  EXPECT_LT((back.back().translation() - Bends().front()).norm(), 0.6);
  // It backs up: it ends as it began.
  EXPECT_NEAR(back.back().yaw(), back.front().yaw(), 0.3);
  EXPECT_NEAR(static_cast<double>(back.size()), 2.0 * static_cast<double>(there.size()), 100.0);
}

TEST(PathDriver, FromTheEndItDrivesTheOtherWay) {
  const Path reversed(Bends().rbegin(), Bends().rend());
  const std::vector<Se2> a = DriveAlong(Bends(), {.from_end = true});
  const std::vector<Se2> b = DriveAlong(reversed, {});
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.front().translation(), Bends().back());
  EXPECT_EQ(a.back().translation(), b.back().translation());
}

TEST(PathDriver, ATurnOfTheWorldTurnsTheDrive) {
  const Se2 T_b_a(40.0, -7.0, 2.0);
  Path turned;
  for (const Eigen::Vector2d& p : Bends()) turned.push_back(T_b_a * p);
  const std::vector<Se2> a = DriveAlong(Bends(), {});
  const std::vector<Se2> b = DriveAlong(turned, {});
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); i += 100) {
    EXPECT_LT((b[i].translation() - T_b_a * a[i].translation()).norm(), 1e-3);
  }
}

}  // namespace
}  // namespace shiftmap

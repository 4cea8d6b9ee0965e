// SPDX-License-Identifier: Apache-2.0
#include "mapper/problem/mode_grid.h"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <utility>

#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

TEST(ModeGrid, VisitsWhatIsNearAndNothingTwice) {
  constexpr double kRadius = 3.0;
  std::mt19937_64 random(testing::TestSeed(91));
  std::uniform_real_distribution<double> coordinate(-20.0, 20.0);
  const auto anywhere = [&] {
    const double x = coordinate(random);
    return Eigen::Vector2d(x, coordinate(random));
  };
  MapProblem problem;
  problem.modes.resize(60);
  for (std::size_t group = 0; group < problem.modes.size(); ++group) {
    for (std::size_t k = 0; k < group % 4; ++k)
      problem.modes[group].push_back({anywhere(), kAbsent});
  }
  const ModeGrid grid(problem, kRadius);
  for (int trial = 0; trial < 200; ++trial) {
    const Eigen::Vector2d point = anywhere();
    std::set<std::pair<int, int>> visited;
    grid.VisitNear(point, [&](const ModeGrid::Entry& entry) {
      EXPECT_TRUE(visited.emplace(entry.group, entry.mode).second);
      // In the cells around it, of a radius each.
      EXPECT_LT((entry.p_map_landmark - point).cwiseAbs().maxCoeff(), 2.0 * kRadius);
      EXPECT_EQ(
          entry.p_map_landmark,
          problem.modes[static_cast<std::size_t>(entry.group)][static_cast<std::size_t>(entry.mode)]
              .p_map_landmark);
    });
    for (std::size_t group = 0; group < problem.modes.size(); ++group) {
      for (std::size_t k = 0; k < problem.modes[group].size(); ++k) {
        if ((problem.modes[group][k].p_map_landmark - point).norm() > kRadius) continue;
        EXPECT_TRUE(visited.contains({static_cast<int>(group), static_cast<int>(k)}));
      }
    }
  }
}

}  // namespace
}  // namespace shiftmap

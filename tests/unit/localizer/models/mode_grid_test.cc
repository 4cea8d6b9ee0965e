// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/mode_grid.h"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <utility>

#include "tests/support/random_map.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

TEST(ModeGrid, FindsWhatABruteForceSearchFinds) {
  constexpr double kCell = 3.0;
  const MapContent content = MakeTwoModeMap(60, 50.0, 4);
  const ModeGrid grid(Snapshot(content), kCell);
  std::mt19937_64 random(testing::TestSeed(8));
  std::uniform_real_distribution<double> place(-30.0, 30.0);
  for (int i = 0; i < 200; ++i) {
    const double x = place(random);
    const Eigen::Vector2d p(x, place(random));
    const double radius = i % 2 == 0 ? kCell : 7.0;
    std::set<std::pair<int, int>> visited;
    grid.VisitNear(p, radius, [&](const ModeGrid::Entry& entry) {
      EXPECT_TRUE(visited.emplace(entry.group, entry.mode).second);
      EXPECT_LT((entry.p_map_landmark - p).cwiseAbs().maxCoeff(), radius + kCell);
      const LandmarkGroup& group = content.groups[static_cast<std::size_t>(entry.group)];
      EXPECT_EQ(entry.p_map_landmark,
                group.modes[static_cast<std::size_t>(entry.mode)].p_map_landmark);
    });
    std::vector<int> expected;
    for (std::size_t g = 0; g < content.groups.size(); ++g) {
      const int group = static_cast<int>(g);
      for (std::size_t k = 0; k < content.groups[g].modes.size(); ++k) {
        if ((content.groups[g].modes[k].p_map_landmark - p).norm() > radius) continue;
        EXPECT_TRUE(visited.contains({group, static_cast<int>(k)}));
        if (expected.empty() || expected.back() != group) expected.push_back(group);
      }
    }
    std::vector<int> found;
    grid.GroupsNear(p, radius, &found);
    EXPECT_EQ(found, expected);
  }
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/waiting_submaps.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>
#include <vector>

#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

constexpr int kGroups = 40;

// Submaps of nothing but groups, each a different number of them.
std::vector<std::set<int>> RandomGroups(int submaps, std::mt19937_64& random) {
  std::uniform_int_distribution<int> group(0, kGroups - 1);
  std::vector<std::set<int>> all;
  for (int i = 0; i < submaps; ++i) {
    std::set<int> groups;
    while (static_cast<int>(groups.size()) < i + 3) groups.insert(group(random));
    all.push_back(std::move(groups));
  }
  return all;
}

Submap MakeSubmapOf(const std::set<int>& groups) {
  Submap submap;
  for (const int group : groups) submap.points.push_back({group, {1.0 * group, 0.0}});
  return submap;
}

WaitingSubmaps Waiting(const std::vector<std::set<int>>& groups, const MapProblem& problem) {
  std::vector<Submap> submaps;
  for (const std::set<int>& of_submap : groups) submaps.push_back(MakeSubmapOf(of_submap));
  return {std::move(submaps), problem};
}

void AddToMap(const std::set<int>& groups, MapProblem* problem) {
  for (const int group : groups) {
    std::vector<BuildMode>& modes = problem->modes[static_cast<std::size_t>(group)];
    if (modes.empty()) modes.push_back({Eigen::Vector2d(1.0 * group, 0.0), kAbsent});
  }
}

// The first of those with most groups that the map has, counted anew.
std::size_t MostShared(const std::vector<std::set<int>>& groups,
                       const std::set<std::size_t>& waiting,
                       const MapProblem& problem) {
  std::size_t best = groups.size();
  std::ptrdiff_t most = 0;
  for (const std::size_t i : waiting) {
    const auto shared = std::count_if(groups[i].begin(), groups[i].end(), [&](int group) {
      return !problem.modes[static_cast<std::size_t>(group)].empty();
    });
    if (shared <= most) continue;
    most = shared;
    best = i;
  }
  return best;
}

TEST(WaitingSubmaps, NextIsTheOneThatSharesMostCountedAnew) {
  std::mt19937_64 random(testing::TestSeed(92));
  for (int trial = 0; trial < 20; ++trial) {
    const std::vector<std::set<int>> groups = RandomGroups(12, random);
    MapProblem problem;
    problem.modes.resize(kGroups);
    WaitingSubmaps submaps = Waiting(groups, problem);
    std::set<std::size_t> waiting;
    for (std::size_t i = 0; i < groups.size(); ++i) waiting.insert(i);
    std::size_t next = *submaps.Largest();
    EXPECT_EQ(next, groups.size() - 1);
    while (true) {
      submaps.Take(next);
      waiting.erase(next);
      AddToMap(groups[next], &problem);
      submaps.Update(next, problem);
      const std::optional<std::size_t> chosen = submaps.Next();
      const std::size_t expected = MostShared(groups, waiting, problem);
      if (!chosen) {
        EXPECT_EQ(expected, groups.size());
        break;
      }
      EXPECT_EQ(*chosen, expected);
      next = *chosen;
    }
    EXPECT_EQ(submaps.Remaining(), std::vector<std::size_t>(waiting.begin(), waiting.end()));
  }
}

TEST(WaitingSubmaps, ReferenceHoldsAllModesOfItsGroupsAndNoOthers) {
  MapProblem problem;
  problem.modes.resize(kGroups);
  problem.modes[3] = {{Eigen::Vector2d(1.0, 2.0), kAbsent}, {Eigen::Vector2d(3.0, 4.0), kAbsent}};
  problem.modes[5] = {{Eigen::Vector2d(5.0, 6.0), kAbsent}};
  problem.modes[9] = {{Eigen::Vector2d(7.0, 8.0), kAbsent}};
  const WaitingSubmaps submaps = Waiting({{3, 5, 7}}, problem);
  const std::vector<AlignmentPoint> reference = submaps.Reference(0, problem);
  ASSERT_EQ(reference.size(), 3u);
  EXPECT_EQ(reference[0].group, 3);
  EXPECT_EQ(reference[1].position, Eigen::Vector2d(3.0, 4.0));
  EXPECT_EQ(reference[2].position, Eigen::Vector2d(5.0, 6.0));
}

TEST(WaitingSubmaps, OneThatWasSetAsideWaitsForOtherModesOfItsGroups) {
  MapProblem problem;
  problem.modes.resize(kGroups);
  AddToMap({1, 2, 3, 4}, &problem);
  WaitingSubmaps submaps = Waiting({{1, 2, 3}, {3, 20}}, problem);
  ASSERT_EQ(submaps.Next(), 0u);
  submaps.SetAside(0);
  ASSERT_EQ(submaps.Next(), 1u);
  submaps.SetAside(1);
  EXPECT_FALSE(submaps.Next());
  // Another mode of a group of the second only.
  submaps.Take(1);
  problem.modes[3].push_back({Eigen::Vector2d(30.0, 30.0), kAbsent});
  problem.modes[20].push_back({Eigen::Vector2d(20.0, 0.0), kAbsent});
  submaps.Update(1, problem);
  EXPECT_EQ(submaps.Next(), 0u);
}

TEST(WaitingSubmaps, IsRightAfterTheMapHasLostModes) {
  MapProblem problem;
  problem.modes.resize(kGroups);
  AddToMap({1, 2, 3, 4, 5}, &problem);
  WaitingSubmaps submaps = Waiting({{1, 2, 3}, {4, 5, 6}}, problem);
  ASSERT_EQ(submaps.Next(), std::optional<std::size_t>(0));
  submaps.SetAside(0);
  ASSERT_EQ(submaps.Next(), std::optional<std::size_t>(1));
  submaps.SetAside(1);
  ASSERT_EQ(submaps.Next(), std::nullopt);
  problem.modes[1].clear();
  problem.modes[2].clear();
  submaps.Recount(problem);
  EXPECT_EQ(submaps.Next(), std::optional<std::size_t>(1));
}

TEST(WaitingSubmaps, TheOrderOfPlacesDoesNotDependOnTheOrderOfSubmaps) {
  // All shared counts differ: submap i has 3 + i groups, all of them in the map.
  std::mt19937_64 random(testing::TestSeed(93));
  std::vector<std::set<int>> groups = RandomGroups(12, random);
  MapProblem problem;
  problem.modes.resize(kGroups);
  for (const std::set<int>& of_submap : groups) AddToMap(of_submap, &problem);
  const auto order = [&] {
    WaitingSubmaps submaps = Waiting(groups, problem);
    std::vector<std::set<int>> taken;
    while (const std::optional<std::size_t> next = submaps.Next()) {
      taken.push_back(groups[*next]);
      submaps.Take(*next);
      submaps.Update(*next, problem);
    }
    return taken;
  };
  const std::vector<std::set<int>> expected = order();
  EXPECT_EQ(expected.size(), groups.size());
  for (int trial = 0; trial < 5; ++trial) {
    std::shuffle(groups.begin(), groups.end(), random);
    EXPECT_EQ(order(), expected);
  }
}

}  // namespace
}  // namespace shiftmap

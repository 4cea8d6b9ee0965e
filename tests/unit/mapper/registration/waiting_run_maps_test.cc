// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/waiting_run_maps.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>
#include <vector>

#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

constexpr int kGroups = 40;

// RunMaps of nothing but groups, each a different number of them.
using GroupSets = IndexedVector<RunMapIndex, std::set<int>>;

GroupSets RandomGroups(int run_maps, std::mt19937_64& random) {
  std::uniform_int_distribution<int> group(0, kGroups - 1);
  GroupSets all;
  for (int i = 0; i < run_maps; ++i) {
    std::set<int> groups;
    while (static_cast<int>(groups.size()) < i + 3) groups.insert(group(random));
    all.push_back(std::move(groups));
  }
  return all;
}

RunMap MakeRunMapOf(const std::set<int>& groups) {
  RunMap run_map;
  for (const int group : groups) run_map.points.push_back({GroupIndex(group), {1.0 * group, 0.0}});
  return run_map;
}

WaitingRunMaps Waiting(const GroupSets& groups, const BuildState& build) {
  std::vector<RunMap> run_maps;
  for (const std::set<int>& of_run_map : groups) run_maps.push_back(MakeRunMapOf(of_run_map));
  return {std::move(run_maps), build};
}

void AddToMap(const std::set<int>& groups, BuildState* build) {
  for (const int group : groups) {
    std::vector<BuildMode>& modes = build->modes[GroupIndex(group)];
    if (modes.empty()) modes.push_back({Eigen::Vector2d(1.0 * group, 0.0), kAbsent});
  }
}

// The first of those with most groups that the map has, counted anew.
RunMapIndex MostShared(const GroupSets& groups,
                       const std::set<RunMapIndex>& waiting,
                       const BuildState& build) {
  RunMapIndex best = groups.end_index();
  std::ptrdiff_t most = 0;
  for (const RunMapIndex i : waiting) {
    const auto shared = std::count_if(groups[i].begin(), groups[i].end(), [&](int group) {
      return !build.modes[GroupIndex(group)].empty();
    });
    if (shared <= most) continue;
    most = shared;
    best = i;
  }
  return best;
}

TEST(WaitingRunMaps, NextIsTheOneThatSharesMostCountedAnew) {
  std::mt19937_64 random(testing::TestSeed(92));
  for (int trial = 0; trial < 20; ++trial) {
    const GroupSets groups = RandomGroups(12, random);
    BuildState build;
    build.modes.resize(kGroups);
    WaitingRunMaps run_maps = Waiting(groups, build);
    std::set<RunMapIndex> waiting;
    for (const RunMapIndex i : groups.indices()) waiting.insert(i);
    RunMapIndex next = *run_maps.Largest();
    EXPECT_EQ(next, groups.end_index() - 1);
    while (true) {
      run_maps.Take(next);
      waiting.erase(next);
      AddToMap(groups[next], &build);
      run_maps.Update(next, build);
      const std::optional<RunMapIndex> chosen = run_maps.Next();
      const RunMapIndex expected = MostShared(groups, waiting, build);
      if (!chosen) {
        EXPECT_EQ(expected, groups.end_index());
        break;
      }
      EXPECT_EQ(*chosen, expected);
      next = *chosen;
    }
    EXPECT_EQ(run_maps.Remaining(), std::vector<RunMapIndex>(waiting.begin(), waiting.end()));
  }
}

TEST(WaitingRunMaps, ReferenceHoldsAllModesOfItsGroupsAndNoOthers) {
  BuildState build;
  build.modes.resize(kGroups);
  build.modes[3] = {{Eigen::Vector2d(1.0, 2.0), kAbsent}, {Eigen::Vector2d(3.0, 4.0), kAbsent}};
  build.modes[5] = {{Eigen::Vector2d(5.0, 6.0), kAbsent}};
  build.modes[9] = {{Eigen::Vector2d(7.0, 8.0), kAbsent}};
  const WaitingRunMaps run_maps = Waiting({{3, 5, 7}}, build);
  const AlignmentPoints reference = run_maps.Reference(0, build);
  ASSERT_EQ(reference.size(), 3u);
  EXPECT_EQ(reference[0].group, GroupIndex(3));
  EXPECT_EQ(reference[1].position, Eigen::Vector2d(3.0, 4.0));
  EXPECT_EQ(reference[2].position, Eigen::Vector2d(5.0, 6.0));
}

TEST(WaitingRunMaps, OneThatWasSetAsideWaitsForOtherModesOfItsGroups) {
  BuildState build;
  build.modes.resize(kGroups);
  AddToMap({1, 2, 3, 4}, &build);
  WaitingRunMaps run_maps = Waiting({{1, 2, 3}, {3, 20}}, build);
  ASSERT_EQ(run_maps.Next(), RunMapIndex(0));
  run_maps.SetAside(0);
  ASSERT_EQ(run_maps.Next(), RunMapIndex(1));
  run_maps.SetAside(1);
  EXPECT_FALSE(run_maps.Next());
  // Another mode of a group of the second only.
  run_maps.Take(1);
  build.modes[3].push_back({Eigen::Vector2d(30.0, 30.0), kAbsent});
  build.modes[20].push_back({Eigen::Vector2d(20.0, 0.0), kAbsent});
  run_maps.Update(1, build);
  EXPECT_EQ(run_maps.Next(), RunMapIndex(0));
}

TEST(WaitingRunMaps, IsRightAfterTheMapHasLostModes) {
  BuildState build;
  build.modes.resize(kGroups);
  AddToMap({1, 2, 3, 4, 5}, &build);
  WaitingRunMaps run_maps = Waiting({{1, 2, 3}, {4, 5, 6}}, build);
  ASSERT_EQ(run_maps.Next(), std::optional<RunMapIndex>(0));
  run_maps.SetAside(0);
  ASSERT_EQ(run_maps.Next(), std::optional<RunMapIndex>(1));
  run_maps.SetAside(1);
  ASSERT_EQ(run_maps.Next(), std::nullopt);
  build.modes[1].clear();
  build.modes[2].clear();
  run_maps.Recount(build);
  EXPECT_EQ(run_maps.Next(), std::optional<RunMapIndex>(1));
}

TEST(WaitingRunMaps, TheOrderOfPlacesDoesNotDependOnTheOrderOfRunMaps) {
  // All shared counts differ: run map i has 3 + i groups, all of them in the map.
  std::mt19937_64 random(testing::TestSeed(93));
  GroupSets groups = RandomGroups(12, random);
  BuildState build;
  build.modes.resize(kGroups);
  for (const std::set<int>& of_run_map : groups) AddToMap(of_run_map, &build);
  const auto order = [&] {
    WaitingRunMaps run_maps = Waiting(groups, build);
    std::vector<std::set<int>> taken;
    while (const std::optional<RunMapIndex> next = run_maps.Next()) {
      taken.push_back(groups[*next]);
      run_maps.Take(*next);
      run_maps.Update(*next, build);
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

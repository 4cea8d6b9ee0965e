// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_site.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

MinePlan Plan(std::uint64_t seed) { return *GenerateMinePlan({.seed = seed}); }

// Whether some point of the path sees a place.
bool SeenFromPath(const RayCaster& walls, const MinePlan& plan, const Eigen::Vector2d& place) {
  for (std::size_t i = 0; i + 1 < plan.path.size(); ++i) {
    for (double share = 0.0; share < 1.0; share += 0.02) {
      const Eigen::Vector2d p = plan.path[i] + share * (plan.path[i + 1] - plan.path[i]);
      if (walls.InSight(p, place)) return true;
    }
  }
  return false;
}

TEST(MineSite, EveryPlaceCanBeSeenFromThePath) {
  const StatusOr<MineSite> site = MakeMineSite(Plan(4), {.corners = true});
  ASSERT_THAT(site, IsOk());
  ASSERT_EQ(site->groups.size(), 3U + 3U + 16U);
  std::vector<Wall> closed = site->plan.original;
  closed.insert(closed.end(), site->plan.entries.begin(), site->plan.entries.end());
  const RayCaster walls(closed);
  for (std::size_t g = 0; g < site->groups.size(); ++g) {
    if (g >= 3 && g < 6) continue;  // Corners are rock.
    for (const Eigen::Vector2d& place : site->groups[g].modes) {
      EXPECT_TRUE(SeenFromPath(walls, site->plan, place)) << site->groups[g].signature.text();
    }
  }
}

TEST(MineSite, NoDrawpointHasTwoBarriers) {
  const StatusOr<MineSite> site = MakeMineSite(Plan(4), {.places_per_barrier = 3});
  ASSERT_THAT(site, IsOk());
  ASSERT_EQ(site->barriers.size(), 3U);
  std::vector<Eigen::Vector2d> places;
  for (const std::vector<Wall>& barrier : site->barriers) {
    EXPECT_GE(barrier.size(), 2U);
    EXPECT_LE(barrier.size(), 3U);
    for (const Wall& wall : barrier) places.push_back(wall.a);
  }
  ASSERT_EQ(places.size(), site->plan.entries.size());
  for (const Wall& entry : site->plan.entries) {
    EXPECT_EQ(std::count(places.begin(), places.end(), entry.a), 1);
  }
}

TEST(MineSite, ABarrierStandsWhereItsModeSays) {
  const StatusOr<MineSite> site = MakeMineSite(Plan(4), {.tags = 0});
  ASSERT_THAT(site, IsOk());
  const std::size_t rock = site->plan.original.size();
  const std::vector<ModeNumber> away(3, kAbsent);
  EXPECT_EQ(site->WallsOf(PlanVersion::kOriginal, away).size(), rock);
  const std::vector<ModeNumber> one = {kAbsent, ModeNumber(2), kAbsent};
  const std::vector<Wall> walls = site->WallsOf(PlanVersion::kOriginal, one);
  ASSERT_EQ(walls.size(), rock + 1);
  EXPECT_EQ(walls.back().a, site->barriers[1][1].a);
  const Eigen::Vector2d middle = 0.5 * (walls.back().a + walls.back().b);
  EXPECT_NEAR((site->groups[1].modes[1] - middle).norm(), 0.05, 1e-9);
}

TEST(MineSite, CornersFollowTheVersion) {
  const StatusOr<MineSite> site = MakeMineSite(Plan(4), {.tags = 1, .corners = true});
  ASSERT_THAT(site, IsOk());
  const std::vector<ModeNumber> modes(7, ModeNumber(1));
  const std::vector<ModeNumber> moved = site->WithCornersOf(PlanVersion::kModified, modes);
  for (std::size_t g = 0; g < 7; ++g) {
    EXPECT_EQ(moved[g], ModeNumber(g >= 3 && g < 6 ? 2 : 1));
    if (g < 3 || g >= 6) continue;
    EXPECT_EQ(site->groups[g].modes[1], site->plan.corners[g - 3].modified);
  }
}

TEST(MineSite, RefusesMoreTagsThanFit) {
  EXPECT_THAT(MakeMineSite(Plan(4), {.tags = 1000}),
              StatusIs(StatusCode::kInvalidArgument, "do not fit"));
  EXPECT_THAT(MakeMineSite(Plan(4), {.places_per_tag = 0}),
              StatusIs(StatusCode::kInvalidArgument, "places per tag = 0"));
}

}  // namespace
}  // namespace shiftmap

// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_plan.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/status_matchers.h"
#include "tools/sim/ray_caster.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

bool Same(const Wall& a, const Wall& b) { return a.a == b.a && a.b == b.b; }

bool HasWallAt(const std::vector<Wall>& walls, const Eigen::Vector2d& p) {
  return std::any_of(walls.begin(), walls.end(), [&](const Wall& wall) {
    return (wall.a - p).norm() < 1e-9 || (wall.b - p).norm() < 1e-9;
  });
}

TEST(MinePlan, IsClosedRockAroundItsPath) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const StatusOr<MinePlan> plan = GenerateMinePlan({.seed = seed});
    ASSERT_THAT(plan, IsOk());
    for (const PlanVersion version : {PlanVersion::kOriginal, PlanVersion::kModified}) {
      const RayCaster walls(plan->walls(version));
      for (std::size_t i = 0; i + 1 < plan->path.size(); ++i) {
        EXPECT_TRUE(walls.InSight(plan->path[i], plan->path[i + 1]));
      }
      for (const Eigen::Vector2d& p : plan->path) {
        for (int degree = 0; degree < 360; ++degree) {
          const double yaw = degree / 57.29577951308232;
          const double range = walls.Cast(p, {std::cos(yaw), std::sin(yaw)}, 1000.0).range_m;
          ASSERT_LT(range, 160.0) << "seed " << seed << ", " << degree << " degrees";
          ASSERT_GT(range, 1.5);
        }
      }
    }
  }
}

TEST(MinePlan, VersionsDifferAtTheirCornersOnly) {
  const StatusOr<MinePlan> plan = GenerateMinePlan({.seed = 3});
  ASSERT_THAT(plan, IsOk());
  ASSERT_EQ(plan->corners.size(), 3U);
  for (const MovedCorner& corner : plan->corners) {
    EXPECT_TRUE(HasWallAt(plan->original, corner.original));
    EXPECT_TRUE(HasWallAt(plan->modified, corner.modified));
    EXPECT_FALSE(HasWallAt(plan->modified, corner.original) &&
                 HasWallAt(plan->original, corner.modified));
  }
  EXPECT_NEAR((plan->corners[0].modified - plan->corners[0].original).norm(), 4.0, 1e-9);
  EXPECT_NEAR((plan->corners[1].modified - plan->corners[1].original).norm(), 4.0, 1e-9);
  EXPECT_NEAR((plan->corners[2].modified - plan->corners[2].original).norm(), 1.5, 1e-9);
  const auto shared =
      std::count_if(plan->original.begin(), plan->original.end(), [&](const Wall& wall) {
        return std::any_of(plan->modified.begin(), plan->modified.end(), [&](const Wall& other) {
          return Same(wall, other);
        });
      });
  EXPECT_GE(shared, std::ssize(plan->original) - 6);
}

TEST(MinePlan, BarriersCloseTheirDrawpoints) {
  const StatusOr<MinePlan> plan = GenerateMinePlan({.seed = 5});
  ASSERT_THAT(plan, IsOk());
  ASSERT_EQ(plan->entries.size(), 7U) << "all drawpoints but the extended one";
  const RayCaster rock(plan->original);
  for (const Wall& entry : plan->entries) {
    const Eigen::Vector2d middle = 0.5 * (entry.a + entry.b);
    const Eigen::Vector2d along = (entry.b - entry.a).normalized();
    const Eigen::Vector2d to_drift(-along.y(), along.x());
    // Both ends are in the rock, and the path can be seen to the left.
    EXPECT_FALSE(rock.InSight(middle, entry.a));
    EXPECT_FALSE(rock.InSight(middle, entry.b));
    EXPECT_GT(rock.Cast(middle, to_drift, 100.0).range_m, 4.0);
  }
}

TEST(MinePlan, RefusesWhatDoesNotFit) {
  EXPECT_THAT(GenerateMinePlan({.drawpoints = 40}),
              StatusIs(StatusCode::kInvalidArgument, "do not fit along 150 m"));
  EXPECT_THAT(GenerateMinePlan({.drawpoints = 1}),
              StatusIs(StatusCode::kInvalidArgument, "1 drawpoints"));
  EXPECT_THAT(GenerateMinePlan({.length_m = -1.0}),
              StatusIs(StatusCode::kInvalidArgument, "length = -1"));
  EXPECT_THAT(GenerateMinePlan({.length_m = 1e9}),
              StatusIs(StatusCode::kInvalidArgument, "length = 1000000000"));
  EXPECT_THAT(GenerateMinePlan({.corner_shift_m = 2.5}),
              StatusIs(StatusCode::kInvalidArgument, "corner shift = 2.5"));
}

TEST(MinePlan, FitsManySizes) {
  for (const int drawpoints : {2, 3, 5, 12}) {
    for (const int crosscuts : {0, 1, 3}) {
      const StatusOr<MinePlan> plan = GenerateMinePlan({.length_m = 16.0 * (drawpoints + crosscuts),
                                                        .drawpoints = drawpoints,
                                                        .crosscuts = crosscuts});
      ASSERT_THAT(plan, IsOk());
      EXPECT_EQ(std::ssize(plan->entries), drawpoints - 1);
      EXPECT_EQ(plan->corners.size(), 3U);
    }
  }
}

}  // namespace
}  // namespace shiftmap

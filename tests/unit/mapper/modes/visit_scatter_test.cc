// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/visit_scatter.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <cstddef>
#include <vector>

#include "mapper/mapper.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

constexpr std::size_t kDoors = 3;

SimulatedWorld StaticRuns(std::uint64_t seed, int runs) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.groups = 15;
  options.modes_per_group = 1;
  options.runs = runs;
  options.duration_s = 400.0;
  options.scan_rate_hz = 4.0;
  return testing::Simulate(options);
}

// The first landmarks are doors: each stands `apart_m` away every other `stay_s` of a run.
SimulatedWorld DoorsWithinRuns(std::uint64_t seed, int runs, double apart_m, double stay_s) {
  SimulatedWorld world = StaticRuns(seed, runs);
  for (SimulatedRun& run : world.runs) {
    auto at = run.truth.begin();
    for (Scan& scan : run.run.scans) {
      while (at->stamp < scan.stamp) ++at;
      const double since_s = ToSeconds(scan.stamp - run.run.scans.front().stamp);
      for (Observation& observation : scan.observations) {
        for (std::size_t door = 0; door < kDoors; ++door) {
          if (world.groups[door].signature != observation.signature) continue;
          const double begun = since_s + 0.3 * stay_s * static_cast<double>(door);
          if (static_cast<int>(begun / stay_s) % 2 == 0) continue;
          const Eigen::Vector2d p =
              at->T_map_vehicle * observation.PositionInVehicle() + Eigen::Vector2d(0.0, apart_m);
          const Eigen::Vector2d q = at->T_map_vehicle.Inverse() * p;
          observation.z = {q.norm(), std::atan2(q.y(), q.x())};
        }
      }
    }
  }
  return world;
}

MapperOptions KnownScale() {
  MapperOptions options;
  options.sd_range_scale = 0.0;
  options.sd_run_range_scale = 0.0;
  return options;
}

// Mean over both places of (p - place)ᵀ P⁻¹ (p - place) / 2 of doors with one mode, without what
// the frame of the map is off; and how many doors have a mode more.
struct DoorsOfMap {
  double nees = 0.0;
  int undivided = 0;
  int divided = 0;
};
void Add(const MapContent& map, const SimulatedWorld& world, double apart_m, DoorsOfMap* doors) {
  const Se2 T_map_world = world.runs[0].truth.front().T_map_vehicle.Inverse();
  const Eigen::Vector2d step = T_map_world.Rotation() * Eigen::Vector2d(0.0, apart_m);
  const Eigen::Vector2d across = step.normalized();
  for (std::size_t door = 0; door < kDoors; ++door) {
    const std::vector<Mode>& modes = map.groups[door].modes;
    if (modes.size() > 1) {
      ++doors->divided;
      continue;
    }
    ++doors->undivided;
    // Of the two places' mean the mode may be anywhere between them.
    const double variance = across.dot(modes[0].cov_p_map_landmark * across);
    doors->nees += 0.25 * apart_m * apart_m / variance;
  }
}

TEST(VisitScatter, AModeBetweenTwoPlacesIsKnownNoBetterThanTheyAreApart) {
  for (const int nights : {1, 3}) {
    for (const double apart_m : {0.3, 0.4}) {
      DoorsOfMap doors;
      for (std::uint64_t seed = 1; seed <= 4; ++seed) {
        const SimulatedWorld world = DoorsWithinRuns(seed, nights, apart_m, 80.0);
        std::optional<MapContent> map;
        for (const MapperInput& run : testing::Inputs(world)) {
          map = BuildMap({run}, map, KnownScale()).value().content;
        }
        Add(*map, world, apart_m, &doors);
      }
      ASSERT_GT(doors.undivided, 0) << apart_m;
      EXPECT_LT(doors.nees / doors.undivided, 3.0) << nights << " nights, " << apart_m;
    }
  }
}

TEST(VisitScatter, PlacesThatVisitsTellApartAreTwoModes) {
  DoorsOfMap doors;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const SimulatedWorld world = DoorsWithinRuns(seed, 3, 0.5, 150.0);
    Add(BuildMap(testing::Inputs(world), std::nullopt, KnownScale()).value().content,
        world,
        0.5,
        &doors);
  }
  EXPECT_GE(doors.divided, 9) << "of 12";
}

// What stands still, or moves by less than the noise of a visit, is one mode that is known as well
// as it was.
TEST(VisitScatter, VisitsThatScatterAsExpectedChangeNothing) {
  int modes = 0;
  int scattered = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const SimulatedWorld world = StaticRuns(seed, 2);
    const MapperResult result =
        BuildMap(testing::Inputs(world), std::nullopt, KnownScale()).value();
    for (const LandmarkGroup& group : result.content.groups) {
      EXPECT_EQ(group.modes.size(), 1U) << seed;
      for (const Mode& mode : group.modes) scattered += mode.cov_p_map_landmark.trace() > 0.0016;
      ++modes;
    }
    const MapContent small =
        BuildMap(testing::Inputs(DoorsWithinRuns(seed, 2, 0.05, 80.0)), std::nullopt, KnownScale())
            .value()
            .content;
    for (const LandmarkGroup& group : small.groups) EXPECT_EQ(group.modes.size(), 1U) << seed;
  }
  EXPECT_LE(scattered, modes / 20);
}

}  // namespace
}  // namespace shiftmap

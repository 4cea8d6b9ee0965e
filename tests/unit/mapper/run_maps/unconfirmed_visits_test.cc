// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/unconfirmed_visits.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <string>

#include "mapper/run_maps/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// Landmarks so far apart that the vehicle drives for a minute from one to the next.
OpenWorldOptions SparseFloor(std::uint64_t seed) {
  OpenWorldOptions options;
  options.seed = seed;
  options.groups = 8;
  options.modes_per_group = 1;
  options.runs = 1;
  options.duration_s = 200.0;
  options.sensor.max_range_m = 5.0;
  return options;
}

std::ptrdiff_t Count(const IndexedVector<VisitIndex, bool>& visits) {
  return std::count(visits.begin(), visits.end(), true);
}

// A misread sighting fits wherever odometry is not known by then, and would tie the map there.
TEST(UnconfirmedVisits, MisreadSightingsTieNoMap) {
  testing::MapConsistency maps;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    OpenWorldOptions options = SparseFloor(seed);
    options.clutter_per_scan = 0.03;
    const SimulatedWorld world = testing::Simulate(options);
    const auto result = BuildMap(testing::Inputs(world), std::nullopt, {});
    if (!result.ok()) continue;  // Too few landmarks came into view.
    for (const LandmarkGroup& group : result->content.groups) {
      EXPECT_EQ(group.modes.size(), 1u) << seed << " " << group.signature.text();
    }
    if (result->content.covariance.size() < 3) continue;
    const testing::MapConsistency map = testing::MeasureConsistency(result->content, world);
    EXPECT_LT(map.nees / map.dof, 10.0) << seed << " " << map.squared_error / map.modes;
    maps.Add(map);
  }
  RecordProperty("nees_per_landmark", std::to_string(maps.PerLandmark()));
  EXPECT_GT(maps.modes, 150);
  EXPECT_LT(maps.PerLandmark(), 3.0);
}

TEST(UnconfirmedVisits, AreConfirmedWhereNothingIsMisread) {
  std::ptrdiff_t unconfirmed = 0;
  std::ptrdiff_t left = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    OpenWorldOptions options = SparseFloor(seed);
    options.groups = 40;
    options.duration_s = 400.0;
    const SimulatedWorld world = testing::Simulate(options);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    const BuildRun& mapped = build.runs[0];
    unconfirmed += Count(UnconfirmedVisits(ModeOptions(), run, mapped.motions));
    left += Count(mapped.unconfirmed);
  }
  EXPECT_GT(unconfirmed, 40);
  EXPECT_LT(10 * left, unconfirmed);
}

// A sensor that is so slow that landmarks are seen once or twice in passing.
TEST(UnconfirmedVisits, AreNoneWhereLandmarksAreSeenInPassing) {
  OpenWorldOptions options = SparseFloor(1);
  options.groups = 40;
  options.scan_rate_hz = 0.5;
  options.duration_s = 400.0;
  const SimulatedWorld world = testing::Simulate(options);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  ASSERT_GT(run.visits.size(), 20u);
  EXPECT_EQ(Count(UnconfirmedVisits(ModeOptions(), run, IntegrateMotions(run, {}))), 0);
}

}  // namespace
}  // namespace shiftmap

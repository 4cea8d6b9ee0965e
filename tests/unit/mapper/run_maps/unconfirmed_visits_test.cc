// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/unconfirmed_visits.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>

#include "mapper/run_maps/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// Landmarks so far apart that the vehicle drives for a minute from one to the next.
OpenWorldOptions SparseFloor(std::uint64_t seed,
                             double scan_rate_hz = OpenWorldOptions().scan_rate_hz,
                             double clutter_per_scan = 0.0) {
  OpenWorldOptions options;
  options.seed = seed;
  options.scan_rate_hz = scan_rate_hz;
  options.clutter_per_scan = clutter_per_scan;
  options.groups = 8;
  options.modes_per_group = 1;
  options.runs = 1;
  options.duration_s = 200.0;
  options.sensor.max_range_m = 5.0;
  return options;
}

IndexedVector<VisitIndex, bool> Unconfirmed(const MappingRun& run, const FrameMotions& motions) {
  return VisitsWithout(run, AgreeingSightings(ModeOptions(), run, motions));
}

std::ptrdiff_t Count(const IndexedVector<VisitIndex, bool>& visits) {
  return std::count(visits.begin(), visits.end(), true);
}

// A misread sighting fits wherever odometry is not known by then, and would tie the map there: one
// in a run, or more than there are right ones, of a fast sensor or of one that sees landmarks twice
// or three times.
TEST(UnconfirmedVisits, MisreadSightingsTieNoMap) {
  for (const double rate_hz : {1.0, 2.0, 5.0}) {
    for (const double clutter : {0.003, 0.03, 0.1}) {
      SCOPED_TRACE(fmt::format("{} Hz, clutter {}", rate_hz, clutter));
      testing::MapConsistency maps;
      int mapped = 0;
      for (std::uint64_t seed = 1; seed <= 40; ++seed) {
        const SimulatedWorld world = testing::Simulate(SparseFloor(seed, rate_hz, clutter));
        const auto result = BuildMap(testing::Inputs(world), std::nullopt, {});
        if (!result.ok()) continue;  // Too few landmarks came into view.
        ++mapped;
        for (const LandmarkGroup& group : result->content.groups) {
          EXPECT_EQ(group.modes.size(), 1u) << seed << " " << group.signature.text();
        }
        if (result->content.covariance.size() < 3) continue;
        const testing::MapConsistency map = testing::MeasureConsistency(result->content, world);
        EXPECT_LT(map.nees / map.dof, 10.0) << seed << " " << map.squared_error / map.modes;
        maps.Add(map);
      }
      EXPECT_GT(mapped, 30);
      EXPECT_LT(maps.PerLandmark(), 3.0);
    }
  }
}

// The same of several runs, at once and one after the other.
TEST(UnconfirmedVisits, MisreadSightingsTieNoMapOfSeveralRuns) {
  testing::MapConsistency at_once;
  testing::MapConsistency in_turn;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    OpenWorldOptions options = SparseFloor(seed, 2.0, 0.05);
    options.groups = 16;
    options.runs = 3;
    const SimulatedWorld world = testing::Simulate(options);
    const auto all = BuildMap(testing::Inputs(world), std::nullopt, {});
    ASSERT_TRUE(all.ok()) << seed << Message(all.status());
    at_once.Add(testing::MeasureConsistency(all->content, world));
    std::optional<MapContent> map;
    for (const MapperInput& input : testing::Inputs(world)) {
      const auto result = BuildMap({input}, map, {});
      if (result.ok()) map = result->content;  // A first one may see too few landmarks.
    }
    ASSERT_TRUE(map) << seed;
    in_turn.Add(testing::MeasureConsistency(*map, world));
  }
  EXPECT_GT(at_once.modes, 120);
  EXPECT_GT(in_turn.modes, 120);
  EXPECT_LT(at_once.PerLandmark(), 4.0);
  EXPECT_LT(in_turn.PerLandmark(), 4.0);
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
    unconfirmed += Count(Unconfirmed(run, mapped.motions));
    left += Count(mapped.unconfirmed);
  }
  EXPECT_GT(unconfirmed, 40);
  EXPECT_LT(10 * left, unconfirmed);
}

// Landmarks that move between runs are told from those that stay, also by a slow sensor.
TEST(UnconfirmedVisits, DoNotHideWhatMovedBetweenRuns) {
  for (const double rate_hz : {1.0, 2.0}) {
    testing::MapConsistency maps;
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      OpenWorldOptions options = SparseFloor(seed, rate_hz);
      options.groups = 30;
      options.modes_per_group = 2;
      options.runs = 3;
      const SimulatedWorld world = testing::Simulate(options);
      const auto result = BuildMap(testing::Inputs(world), std::nullopt, {});
      ASSERT_TRUE(result.ok()) << seed << Message(result.status());
      if (result->runs[0].name != "run-0") continue;  // It waits, and the frame is another's.
      const testing::MapConsistency map = testing::MeasureConsistency(result->content, world);
      EXPECT_LT(map.nees / map.dof, 10.0) << rate_hz << " Hz, " << seed;
      maps.Add(map);
    }
    EXPECT_GT(maps.modes, 300);
    EXPECT_LT(maps.PerLandmark(), 4.0);
  }
}

// A slow sensor that misreads a few signatures keeps the rest of its map.
TEST(UnconfirmedVisits, AFewMisreadOnesLoseNoMapOfASlowSensor) {
  testing::MapConsistency maps;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    OpenWorldOptions options = SparseFloor(seed, 1.0, 0.05);
    options.groups = 30;
    options.duration_s = 400.0;
    const SimulatedWorld world = testing::Simulate(options);
    const auto result = BuildMap(testing::Inputs(world), std::nullopt, {});
    ASSERT_TRUE(result.ok()) << seed << Message(result.status());
    maps.Add(testing::MeasureConsistency(result->content, world));
  }
  EXPECT_GT(maps.modes, 400);
  EXPECT_LT(maps.PerLandmark(), 4.0);
}

// A sensor that is so slow that landmarks are seen once or twice in passing.
TEST(UnconfirmedVisits, AreTrustedWhereLandmarksAreSeenInPassing) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    OpenWorldOptions options = SparseFloor(seed, 0.5);
    options.groups = 40;
    options.duration_s = 400.0;
    const SimulatedWorld world = testing::Simulate(options);
    const MappingRun run = testing::Arrange(world, world.runs[0].run);
    const BuildState build = MapSingleRun(run, world.groups.size(), {});
    const BuildRun& mapped = build.runs[0];
    const auto unconfirmed = Unconfirmed(run, mapped.motions);
    EXPECT_GT(2 * Count(unconfirmed), std::ssize(run.visits)) << seed;
    const auto trusted = TrustedSightings({}, build);
    EXPECT_EQ(std::count(trusted.begin(), trusted.end(), false), 0) << seed;
    EXPECT_EQ(Count(mapped.unconfirmed), 0) << seed;
  }
}

TEST(UnconfirmedVisits, ARunWithoutThemKeepsItsKeyFramesAndTheOtherSightings) {
  const double rate_hz = OpenWorldOptions().scan_rate_hz;
  const SimulatedWorld world = testing::Simulate(SparseFloor(1, rate_hz, 0.1));
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const auto agreeing = AgreeingSightings(ModeOptions(), run, IntegrateMotions(run, {}));
  const MappingRun part = OnlySightings(run, agreeing);
  ASSERT_LT(part.visits.size(), run.visits.size());
  ASSERT_EQ(part.frames.size(), run.frames.size());
  SightingIndex next(0);
  for (const FrameIndex frame : run.frames.indices()) {
    EXPECT_EQ(part.frames[frame].first_sighting, next);
    for (const SightingIndex s : run.frames[frame].sightings()) {
      if (!agreeing[s]) continue;
      const Sighting& sighting = part.sightings[next];
      EXPECT_EQ(sighting.frame, frame);
      EXPECT_EQ(sighting.observation.PositionInVehicle(),
                run.sightings[s].observation.PositionInVehicle());
      const MappingVisit& visit = part.visits[sighting.visit];
      EXPECT_EQ(visit.group, run.visits[run.sightings[s].visit].group);
      EXPECT_EQ(std::count(visit.sightings.begin(), visit.sightings.end(), next), 1);
      ++next;
    }
    EXPECT_EQ(next - part.frames[frame].first_sighting, part.frames[frame].sighting_count);
  }
  EXPECT_EQ(next, part.sightings.end_index());
  for (const MappingVisit& visit : part.visits) EXPECT_FALSE(visit.sightings.empty());
}

// Where most signatures are misread, so many agree by chance that a map may rest on them.
TEST(UnconfirmedVisits, ARunThatMisreadsMostIsLeftOut) {
  const double rate_hz = OpenWorldOptions().scan_rate_hz;
  MapperOptions lenient;
  lenient.plausibility.max_outliers = 0.9999;
  int left_out = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const SimulatedWorld world = testing::Simulate(SparseFloor(seed, rate_hz, 0.2));
    if (!BuildMap(testing::Inputs(world), std::nullopt, lenient).ok()) continue;
    const auto result = BuildMap(testing::Inputs(world), std::nullopt, {});
    if (result.ok()) continue;
    ++left_out;
    EXPECT_THAT(Message(result.status()), ::testing::HasSubstr("signatures are misread")) << seed;
  }
  EXPECT_GT(left_out, 10);
}

}  // namespace
}  // namespace shiftmap

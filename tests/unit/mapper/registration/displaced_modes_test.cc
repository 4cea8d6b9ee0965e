// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/displaced_modes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "mapper/mapper.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// Two runs on a floor of two rooms. The second run sees one room, then nothing for a minute in
// which it turns by `turn_rad` that its odometry knows nothing of, then the other room. Odometry
// that loses 0.23 rad in a minute does that.
SimulatedWorld TwoRooms(std::uint64_t seed, double turn_rad) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.groups = 24;
  options.modes_per_group = 1;
  options.size_m = 20.0;
  options.runs = 2;
  options.duration_s = 400.0;
  options.odometry.noise_omega = 0.03;
  SimulatedWorld world = testing::Simulate(options);
  Run& run = world.runs[1].run;
  const Stamp dark = run.odometry.front().stamp + FromSeconds(170.0);
  const Stamp light = dark + FromSeconds(60.0);
  for (OdometrySample& sample : run.odometry) {
    if (sample.stamp >= dark && sample.stamp < light) sample.omega_radps += turn_rad / 60.0;
  }
  std::set<Signature> left;
  for (const SimulatedGroup& group : world.groups) {
    if (group.modes.front().x() < 0.5 * options.size_m) left.insert(group.signature);
  }
  for (Scan& scan : run.scans) {
    std::erase_if(scan.observations, [&](const Observation& observation) {
      if (scan.stamp < dark) return !left.contains(observation.signature);
      return scan.stamp < light || left.contains(observation.signature);
    });
  }
  return world;
}

MapContent MapOfFirstRun(const SimulatedWorld& world) {
  StatusOr<MapperResult> first = BuildMap({testing::Inputs(world)[0]}, std::nullopt, {});
  EXPECT_TRUE(first.ok()) << first.status();
  return first->content;
}

// The signatures of landmarks that got a mode beside the prior map's, or nothing.
std::optional<std::set<std::string>> Displaced(const SimulatedWorld& world,
                                               const MapContent& prior,
                                               const MapperOptions& options = {}) {
  const StatusOr<MapperResult> result = BuildMap({testing::Inputs(world)[1]}, prior, options);
  if (!result.ok()) return std::nullopt;
  std::set<std::string> displaced;
  for (const LandmarkGroup& group : result->content.groups) {
    if (group.modes.size() > 1) displaced.insert(group.signature.text());
  }
  return displaced;
}

TEST(FindDisplacedModes, ARunThatLostItsHeadingHasDisplacedNothing) {
  for (const double turn_rad : {-0.5, -0.25, 0.25, 0.5}) {
    for (const std::uint64_t seed : {1u, 2u, 3u}) {
      const SimulatedWorld world = TwoRooms(seed, turn_rad);
      EXPECT_EQ(Displaced(world, MapOfFirstRun(world)), std::set<std::string>())
          << turn_rad << " rad, seed " << seed;
    }
  }
}

// The run is far from the tangent on which its covariance is.
TEST(FindDisplacedModes, ADeformedRunIsSolvedAgain) {
  const SimulatedWorld world = TwoRooms(1, -0.5);
  const MapContent prior = MapOfFirstRun(world);
  MapperOptions options;
  options.deformation.stiff_sd_m = 1e3;
  EXPECT_EQ(Displaced(world, prior, options), std::set<std::string>());
  options.deformation.max_linear_m = 1e3;
  const std::optional<std::set<std::string>> by_tangent = Displaced(world, prior, options);
  ASSERT_TRUE(by_tangent);
  EXPECT_FALSE(by_tangent->empty());
}

TEST(FindDisplacedModes, WhatMovedIsFoundWhereTheRunLostItsHeading) {
  for (const double turn_rad : {-0.4, 0.4}) {
    for (const std::uint64_t seed : {1u, 2u, 3u}) {
      const SimulatedWorld world = TwoRooms(seed, turn_rad);
      MapContent prior = MapOfFirstRun(world);
      std::set<std::string> moved;
      for (const std::size_t group : {4u, 11u}) {
        for (Mode& mode : prior.groups[group].modes) mode.p_map_landmark.x() += 0.7;
        moved.insert(prior.groups[group].signature.text());
      }
      EXPECT_EQ(Displaced(world, prior), moved) << turn_rad << " rad, seed " << seed;
    }
  }
}

// The run sees few landmarks, of which about as many have moved together as have stayed.
TEST(FindDisplacedModes, WhereItIsNotDecidedWhatMovedTheRunWaits) {
  int waits = 0;
  for (const std::uint64_t seed : {1u, 2u, 3u, 4u, 5u, 6u}) {
    OpenWorldOptions options = testing::SmallWorld(seed);
    options.groups = 11;
    options.modes_per_group = 1;
    options.runs = 2;
    const SimulatedWorld world = testing::Simulate(options);
    MapContent prior = MapOfFirstRun(world);
    std::set<Signature> moved;
    std::sort(prior.groups.begin(), prior.groups.end(), [](const auto& a, const auto& b) {
      return a.modes.front().p_map_landmark.x() < b.modes.front().p_map_landmark.x();
    });
    for (std::size_t group = 0; group < 5; ++group) {
      prior.groups[group].modes.front().p_map_landmark.y() += 1.0;
      moved.insert(prior.groups[group].signature);
    }
    std::sort(prior.groups.begin(), prior.groups.end(), [](const auto& a, const auto& b) {
      return a.signature < b.signature;
    });
    const StatusOr<MapperResult> result = BuildMap({testing::Inputs(world)[1]}, prior, {});
    ASSERT_TRUE(result.ok()) << result.status();
    if (!result->runs.empty()) continue;
    ++waits;
    ASSERT_EQ(result->ambiguous_changes.size(), 1u) << seed;
    bool has_truth = false;
    for (const AmbiguousChange::Alternative& explanation :
         result->ambiguous_changes.front().explanations) {
      has_truth |= std::set<Signature>(explanation.moved.begin(), explanation.moved.end()) == moved;
    }
    EXPECT_TRUE(has_truth) << seed;
  }
  EXPECT_GE(waits, 4);
}

}  // namespace
}  // namespace shiftmap

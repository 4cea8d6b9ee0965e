// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/moving_visits.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

using ::testing::IsEmpty;
using ::testing::Pair;
using ::testing::UnorderedElementsAre;

Observation At(const char* signature, const Eigen::Vector2d& p_vehicle) {
  Observation observation;
  observation.signature = Signature(signature);
  observation.z = {p_vehicle.norm(), std::atan2(p_vehicle.y(), p_vehicle.x())};
  return observation;
}

TEST(MovingVisits, ACodeOnTheVehicleMoves) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    shiftmap::Run run = testing::StaticWorld(seed).runs[0].run;
    for (Scan& scan : run.scans) scan.observations.push_back(At("own", {1.0, 0.3}));
    EXPECT_THAT(MovingSightings(run, {}),
                UnorderedElementsAre(Pair(Signature("own"), static_cast<int>(run.scans.size()))))
        << seed;
  }
}

// The map and its trajectory are as if the code were not there.
TEST(MovingVisits, ACodeOnTheVehicleChangesNoMap) {
  const SimulatedWorld world = testing::Simulate(testing::SmallWorld(1));
  SimulatedWorld with = world;
  for (SimulatedRun& simulated : with.runs) {
    for (Scan& scan : simulated.run.scans) {
      if (scan.observations.empty()) continue;  // No key frame by itself.
      scan.observations.push_back(At("own", {1.0, 0.3}));
    }
  }
  const auto expected = BuildMap(testing::Inputs(world), std::nullopt, {});
  const auto result = BuildMap(testing::Inputs(with), std::nullopt, {});
  ASSERT_TRUE(expected.ok() && result.ok());
  EXPECT_EQ(testing::ErrorsOf(result->content, world).errors,
            testing::ErrorsOf(expected->content, world).errors);
}

// Of a vehicle that drives ahead of this one for a while, again and again.
TEST(MovingVisits, ACodeOnAnotherVehicleMoves) {
  SimulatedRun simulated = testing::StaticWorld(1).runs[0];
  const Stamp begin = simulated.truth.front().stamp;
  int seen = 0;
  for (Scan& scan : simulated.run.scans) {
    const double t = std::fmod(ToSeconds(scan.stamp - begin), 50.0);
    if (t > 30.0) continue;
    scan.observations.push_back(At("other", {4.0 + 0.1 * t, 2.0 * std::sin(0.2 * t)}));
    ++seen;
  }
  EXPECT_THAT(MovingSightings(simulated.run, {}),
              UnorderedElementsAre(Pair(Signature("other"), ::testing::Gt(seen / 2))));
}

TEST(MovingVisits, WhatCountsAsMovingIsAnOption) {
  shiftmap::Run run = testing::StaticWorld(1).runs[0].run;
  for (Scan& scan : run.scans) scan.observations.push_back(At("own", {1.0, 0.3}));
  const auto moving = [&](const MovingVisitOptions& options) {
    return MovingSightings(run, {.moving = options}).size();
  };
  EXPECT_EQ(moving({}), 1u);
  EXPECT_EQ(moving({.min_way_m = 1e3}), 0u);
  EXPECT_EQ(moving({.max_time_s = 1e-3}), 0u);
  EXPECT_EQ(moving({.moved_share = 10.0}), 0u);
  EXPECT_EQ(moving({.min_moves = 10000}), 0u);
  // The noise of ranges and bearings is some of the way.
  const MovingVisitOptions easy{.moved_share = 0.1, .min_moves = 1, .min_moves_per_standing = 0};
  MovingVisitOptions hard = easy;
  hard.min_moves_per_standing = 1000;
  EXPECT_GT(moving(easy), moving(hard));
}

TEST(MovingVisits, LandmarksStandWhateverTheOdometryDoes) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const SimulatedRun right = testing::StaticWorld(seed).runs[0];
    const Stamp begin = right.truth.front().stamp;
    for (const auto& [speed, turn] : {std::pair(1.0, 1.0),
                                      std::pair(3.6, 1.0),
                                      std::pair(-1.0, 1.0),
                                      std::pair(1.0, -1.0),
                                      std::pair(0.0, 0.0),
                                      std::pair(1.0, 2.0)}) {
      shiftmap::Run run = right.run;
      for (OdometrySample& sample : run.odometry) {
        sample.v_mps *= speed;
        sample.omega_radps *= turn;
      }
      EXPECT_THAT(MovingSightings(run, {}), IsEmpty()) << seed << ' ' << speed << ' ' << turn;
    }
    shiftmap::Run slipping = right.run;
    for (OdometrySample& sample : slipping.odometry) {
      if (std::fmod(ToSeconds(sample.stamp - begin), 40.0) < 15.0) sample.v_mps = 4.0;
    }
    EXPECT_THAT(MovingSightings(slipping, {}), IsEmpty()) << seed;
    const SimulatedRun carried = testing::CarriedMeanwhile(
        right, begin + std::chrono::seconds(80), begin + std::chrono::seconds(120));
    EXPECT_THAT(MovingSightings(carried.run, {}), IsEmpty()) << seed;
  }
}

// Of a vehicle that circles around "mid", which it always sees to its left.
shiftmap::Run RunAround(double radius) {
  constexpr double kTurn = 0.3;
  std::vector<std::pair<std::string, Eigen::Vector2d>> landmarks = {{"mid", {0.0, 0.2}}};
  for (int i = 0; i < 8; ++i) {
    landmarks.emplace_back(std::to_string(i), Se2(0.0, 0.0, 0.8 * i) * Eigen::Vector2d(10.0, 0.0));
  }
  shiftmap::Run run;
  for (int i = 0; i < 1000; ++i) {
    const double t = 0.2 * i;
    const Stamp stamp = StampFromSeconds(100.0 + t);
    const Se2 T_vehicle_map =
        (Se2(0.0, 0.0, kTurn * t) * Se2(Eigen::Vector2d(0.0, -radius), 0.0)).Inverse();
    run.odometry.push_back({stamp, kTurn * radius, kTurn});
    Scan& scan = run.scans.emplace_back();
    scan.stamp = stamp;
    for (const auto& [name, p] : landmarks) {
      const Eigen::Vector2d seen = T_vehicle_map * p;
      if (seen.norm() < 9.0) scan.observations.push_back(At(name.c_str(), seen));
    }
  }
  return run;
}

// By odometry of another scale the middle of a circle moves as a code on the vehicle does.
TEST(MovingVisits, TheMiddleOfACircleStandsWhateverTheScales) {
  for (const double radius : {3.0, 4.0}) {
    for (const auto& [speed, turn] : {std::pair(1.0, 1.0),
                                      std::pair(1.5, 1.0),
                                      std::pair(1.8, 0.7),
                                      std::pair(0.6, 1.4),
                                      std::pair(0.7, 1.0)}) {
      shiftmap::Run run = RunAround(radius);
      for (OdometrySample& sample : run.odometry) {
        sample.v_mps *= speed;
        sample.omega_radps *= turn;
      }
      EXPECT_THAT(MovingSightings(run, {}), IsEmpty()) << radius << ' ' << speed << ' ' << turn;
      for (Scan& scan : run.scans) scan.observations.push_back(At("own", {1.0, 0.3}));
      EXPECT_THAT(MovingSightings(run, {}),
                  UnorderedElementsAre(Pair(Signature("own"), ::testing::_)))
          << radius << ' ' << speed << ' ' << turn;
    }
  }
}

}  // namespace
}  // namespace shiftmap
